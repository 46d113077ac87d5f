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

import argparse
import contextlib
import dataclasses
import json
import os
import sys
import textwrap
import warnings
from pathlib import Path
from typing import Any

from everystate import config_file
from everystate.cli.completion import script
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
    parse,
)
from everystate.cli.progress import working
from everystate.config import Config
from everystate.errors import EverystateError, suggest
from everystate.presets import preset


def train(argv: list[str], command: str = "train", run_dir: Path | None = None) -> Path:
    """Train an agent, or go on; returns the folder of the run."""
    peek = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    peek.add_argument("--preset", nargs="?")
    peek.add_argument("--config", nargs="?", type=Path)
    early = peek.parse_known_args(argv)[0]
    given = config_file.read(early.config) if early.config else {}
    named = bool(argv) and not argv[0].startswith("-")
    if not named and "body" not in given and {"-h", "--help"}.isdisjoint(argv):
        raise EverystateError("name the body first: everystate train BODY [options]")
    given["body"] = body = argv[0] if named else given.get("body", Train.body)
    of_file = given.pop("preset", Train.preset)
    name = early.preset or of_file
    try:
        numbers = preset(name, **given)
    except EverystateError as error:
        raise EverystateError(f"{early.config}: {error}" if early.config else error) from error
    defaults = Train(**dataclasses.asdict(numbers), preset=name, run_dir=run_dir)
    options = parse(Train, command, argv, defaults)
    if options.body != body:
        raise EverystateError(f"name the body first: everystate {command} {options.body} [options]")
    fields = {field.name: getattr(options, field.name) for field in dataclasses.fields(Config)}
    from everystate import training

    if (options.hosts, options.coordinator, options.host_id) != (1, None, None):
        training.join(options.hosts, options.coordinator, options.host_id)
    config = Config(**fields)
    named = training.default_run_dir(config, early.config.stem if early.config else name)
    body, how = fields.pop("body"), {"progress": "plain" if options.quiet else True}
    with (
        _crew(options.collectors, options.ray_address) as how["crew"],
        _tracker(options.track, (options.run_dir or named).name, config) as how["on_epoch"],
    ):
        return training.train(body, preset=name, run_dir=options.run_dir or named, **how, **fields)


def _tracker(tool: Any, name: str, config: Config) -> contextlib.AbstractContextManager[Any]:
    from everystate import training

    if tool is None or not training.leads():
        return contextlib.nullcontext()
    return training.Tracker(tool, name=name, config=dataclasses.asdict(config))


def _crew(collectors: int, address: str | None) -> contextlib.AbstractContextManager[Any]:
    if collectors:
        from everystate import scaling

        return scaling.on_ray(collectors, address)
    if address:
        raise EverystateError(
            f"--ray-address {address} is of no use without collectors: say --collectors N too"
        )
    return contextlib.nullcontext()


def evaluate(argv: list[str]) -> None:
    """Print what a run can reach."""
    options = parse(Evaluate, "evaluate", argv)
    from everystate import evaluation

    _refuse_existing(options.out)
    with working("measuring") as count:
        result = evaluation.evaluate(
            options.run,
            on_step=count,
            suite=options.suite or None,
            split=options.split,
            plan=options.plan,
            episodes=options.episodes,
            skills=options.skills,
            perturb=options.perturb == "grid",
        )
    _tell(result, options)


def score(argv: list[str]) -> None:
    """Print what a recording comes to."""
    options = parse(Score, "score", argv)
    _refuse_existing(options.out)
    from everystate import benchmark

    with working("scoring"):
        result = benchmark.score(options.file, options.suite)
    _tell(result, options)


def _refuse_existing(out: Path | None) -> None:
    if out and out.exists():
        raise EverystateError(f"{out} exists already: choose another --out")


def _tell(result: dict[str, Any], options: Evaluate | Score) -> None:
    """Writes and prints a result as the options say."""
    from everystate import evaluation
    from everystate.evaluation import raw

    if options.out:
        raw.write(options.out, result)
    if options.json:
        print(json.dumps(result))
        return
    for table in evaluation.tables(result):
        _print(table)


def compare(argv: list[str]) -> None:
    """Train and measure several agents side by side."""
    options = parse(Compare, "compare", argv)
    from everystate import studies

    shared = options.body, options.minutes, options.preset, options.episodes, options.plan
    out = options.out or Path("runs") / f"compare-{Path(options.body).stem}"
    if options.rescore:
        result = studies.rescore(options.body, out, workers=options.workers)
    else:
        terms = studies.Terms(*shared)
        how = {"workers": options.workers}
        result = studies.compare(terms, options.agents, options.seeds, out, **how)
    print(studies.table(result))
    print(f"in {out}")


def sweep(argv: list[str]) -> None:
    """Train and measure many runs."""
    options = parse(Sweep, "sweep", argv)
    from everystate import studies

    study = studies.read(options.file)
    out = options.out or Path("runs") / f"sweep-{options.file.stem}"
    failed: list[str] = []
    if not options.table_only:
        where = {"workers": options.workers, "address": options.ray_address}
        failed = studies.sweep(study, out, **where)
    print(studies.write(study, out), end="")
    print(f"in {out}")
    studies.complain(failed)


def report(argv: list[str]) -> None:
    """Draw the page of a run."""
    options = parse(Report, "report", argv)
    from everystate import agent, evaluation, viewing

    loaded = agent.load(options.run)
    plan = loaded.act_with == "plan" if options.planning is None else options.planning
    viewing.report_folder(options.run, options.out)  # better said now than after the measuring
    with working("measuring") as count:
        result = evaluation.evaluate(
            options.run, plan=plan, episodes=options.episodes, on_step=count
        )
    with working("drawing"):
        page = viewing.report(options.run, result, agent=loaded, out=options.out)
    print(page)


def render(argv: list[str]) -> None:
    """Film an agent."""
    options = parse(Render, "render", argv)
    from everystate import goals, viewing

    goal = None if options.goal is None else goals.read(options.goal)
    with working("filming"):
        path = viewing.render(
            options.run,
            options.out,
            skill=options.skill,
            goal=goal,
            explore=options.explore,
            steps=options.steps,
            plan=options.planning,
            seed=options.seed,
            size=options.size,
        )
    print(path)


def studio(argv: list[str]) -> None:
    """Serve the page of an agent."""
    options = parse(Studio, "studio", argv)
    from everystate.viewing.studio import studio

    where = {"host": options.host, "port": options.port}
    studio(options.run, **where, plan=options.planning, seed=options.seed)


def demo(argv: list[str]) -> None:
    """Train, evaluate and report on the Ramp Pointmass."""
    run_dir = train(["ramp-pointmass", *argv], "demo", Path("runs/ramp-pointmass-demo"))
    from everystate import evaluation, viewing

    with working("measuring") as count:
        result = evaluation.evaluate(run_dir, on_step=count)
    for table in evaluation.tables(result):
        _print(table)
    print(f"report:      {viewing.report(run_dir, result)}")
    print(f"run:         {run_dir}")
    print(f"all metrics: {run_dir}/metrics.jsonl, and {run_dir}/tensorboard for TensorBoard")
    print(f"in Python:   everystate.load({str(run_dir)!r}).act(observation, goal)")


def export(argv: list[str]) -> None:
    """Write the agent of a run to a folder or one file."""
    options = parse(Export, "export", argv)
    from everystate import agent

    print(agent.load(options.run).export(options.out, half=options.half))


_ROBOTS = """\
Robots by name, from a folder that MENAGERIE_ROOT names (a checkout of MuJoCo Menagerie) or from an
installed package:"""
_OTHERS = """\
Also the path of any MJCF file, NAME.xml, and MODULE:ID for what a module registers with
Gymnasium: gymnasium:Pendulum-v1. `everystate bodies NAME` describes it. With a run on an
MJCF file or a robot, and with its agent, travel a copy of it and of all files that it names
(meshes, textures, includes), and a hash of the model that it compiles to."""


def bodies(argv: list[str]) -> None:
    """List the bodies, those built in and robots by name, or describe the ones named."""
    options = parse(Bodies, "bodies", argv)
    from everystate import envs
    from everystate.features import features

    how = envs.parse_options(options.body_options)
    for name in options.body or envs.BODIES:
        env = envs.make(name, 1, 0, **how)
        print(envs.describe(env) if options.body else envs.headline(env))
        named = [f"{f.name} ({f.unit})" for f in features(env.state_names).values()]
        if options.body and named:
            print(
                textwrap.fill(
                    f"  goals can also ask for {', '.join(named)}", 78, subsequent_indent="    "
                )
            )
        print()
    if not options.body:
        print(f"{_ROBOTS}\n\n{envs.list_robots()}\n\n{_OTHERS}")


def skills(argv: list[str]) -> None:
    """List the named skills of all bodies that have some, or of the ones named."""
    named = parse(Skills, "skills", argv).body
    from everystate.skills import SKILLS, skills_of

    for body in named or SKILLS:
        known = skills_of(body)
        print(f"{body}:")
        for name, skill in known.items():
            print(f"  {name}: {skill.text}")


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


def _print(table: Any) -> None:
    from rich.console import Console

    Console().print(table)
