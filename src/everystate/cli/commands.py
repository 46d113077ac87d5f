"""Usage: everystate COMMAND [options].

  train BODY     let an agent teach itself a body, or go on with a run
  evaluate RUN   measure what it can reach [--json]
  score FILE     score recorded ways of anybody's agent [--json]
  compare BODY   train and measure several agents side by side, ours and others'
  sweep FILE     train and measure many runs: conditions x seeds [on a cluster]
  report RUN     draw a page of pictures of a run
  render RUN     film an agent performing a skill, going to a goal or exploring
  studio RUN     watch an agent in the browser and send it about
  demo           all three on the Ramp Pointmass, in minutes
  export RUN OUT write its agent to a folder, or to NAME.zip, one file to share
  bodies [BODY]  list the bodies, or describe the states and actions of one
  skills [BODY]  list the named skills, for `evaluate --skills` and `agent.perform`
  completion     print a script by which bash or zsh completes all this

`everystate COMMAND --help` lists the options, `everystate --version` says which this is. Exit
codes: 0 done, 2 a mistake to mend (nothing is written or lost), 130 interrupted by Ctrl-C (saved;
the same command goes on).
"""

import os
import sys
import warnings

from everystate.cli.completion import script
from everystate.cli.learning import demo, train
from everystate.cli.listing import bodies, skills
from everystate.cli.measuring import compare, evaluate, score, sweep
from everystate.cli.options import (
    Bodies,
    Compare,
    Completion,
    Evaluate,
    Export,
    Render,
    Report,
    Score,
    Skills,
    Studio,
    Sweep,
    Train,
)
from everystate.cli.parsing import parse
from everystate.cli.showing import export, render, report, studio
from everystate.errors import EverystateError, suggest


def completion(argv: list[str]) -> None:
    """Print a script by which a shell completes commands."""
    print(script(parse(Completion, "completion", argv).shell, KINDS), end="")


_FUNCTIONS = (
    *(train, evaluate, score, compare, sweep, report, render, studio, demo),
    *(export, bodies, skills, completion),
)
COMMANDS = {f.__name__: f for f in _FUNCTIONS}
_OPTIONS = (
    *(Train, Evaluate, Score, Compare, Sweep, Report, Render, Studio),
    *(Export, Bodies, Skills, Completion),
)
KINDS = {kind.__name__.lower(): kind for kind in _OPTIONS} | {"demo": Train}
"""The options of each command."""


def main(argv: list[str] | None = None) -> int:
    """Runs one command and returns its exit code."""
    argv = sys.argv[1:] if argv is None else argv
    warnings.formatwarning = lambda message, *_, **__: f"warning: {message}\n"
    try:
        if not argv or argv[0] in ("-h", "--help"):
            print(__doc__)
        elif argv[0] == "--version":
            from importlib.metadata import version  # imports an e-mail parser

            print("everystate", version("everystate"))
        elif argv[0] not in COMMANDS:
            raise EverystateError(f"unknown command {argv[0]!r}: {suggest(argv[0], COMMANDS)}")
        else:
            COMMANDS[argv[0]](argv[1:])
        sys.stdout.flush()
    except BrokenPipeError:  # who reads this, as `head`, has had enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except EverystateError as error:
        print("error:", " ".join(str(error).split()), file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130
    return 0
