"""Usage: everystate COMMAND [options].

  train BODY     let an agent teach itself a body, or go on with a run
  evaluate RUN   measure what it can reach [--json]
  compare BODY   train and measure several agents side by side, ours and others'
  report RUN     draw a page of pictures of a run
  render RUN     film an agent performing a skill, going to a goal or exploring
  studio RUN     watch an agent in the browser and send it about
  demo           all three on the Ramp Pointmass, in minutes
  bodies [BODY]  list the bodies and their states, or describe any other
  skills [BODY]  list the named skills, for `evaluate --skills` and `agent.perform`

`everystate COMMAND --help` lists the options. Exit codes: 0 done, 2 a mistake to mend (nothing is
written or lost), 130 interrupted by Ctrl-C (saved; the same command goes on).
"""

import argparse
import contextlib
import dataclasses
import io
import itertools
import json
import sys
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal

import tyro

from everystate.config import Config
from everystate.errors import EverystateError, suggest
from everystate.presets import preset


@dataclasses.dataclass(frozen=True)
class Train(Config):
    """Trains an agent; the same command goes on with a run that was interrupted."""

    body: tyro.conf.Positional[str] = "ramp-pointmass"
    """Body to learn; `everystate bodies` lists them."""
    preset: str = "quick"
    """Preset: quick (for two cores), paper, literal (paper without stabilisers) or test. It sets
    the defaults of the options below."""
    run_dir: Path | None = None
    """Folder of the run, by default runs/BODY-PRESET-seedSEED."""
    quiet: bool = False
    """A plain line every few epochs instead of a progress bar."""


@dataclasses.dataclass(frozen=True)
class Evaluate:
    """Measures what an agent can reach, by region; how it explored; and how safe it is."""

    run: tyro.conf.Positional[Path]
    """Run folder, exported agent, or the name of an agent that comes with everystate."""
    json: bool = False
    """The last line is one JSON object."""
    goals: Path | None = None
    """A goal suite of your own, in the form of those in everystate/evaluation/suites."""
    episodes: int | None = None
    """Only so many goals, evenly taken from the suite."""
    plan: bool = True
    """Measure planning at act time too."""
    skills: bool = False
    """Measure the named skills of the body too."""
    perturb: Literal["grid"] | None = None
    """Measure it in worlds of other masses, motors and noise too: worst, and the worst tenth."""


@dataclasses.dataclass(frozen=True)
class Compare:
    """Trains agents on one body for the same time, each on one core, and measures them alike.

    Agents: ours (as `everystate train` makes it), ours-least-likely, ours-density, ours-visited,
    ours-skew-fit and ours-mega (by other choices of goals), sac-her, tqc-her and random.
    """

    body: tyro.conf.Positional[str]
    """Body to learn; `everystate bodies` lists them."""
    agents: tuple[str, ...] = ("ours", "sac-her", "random")
    """Whom to compare."""
    seeds: int = 5
    """Runs of each, of seeds 0, 1, and so on."""
    minutes: float = 10.0
    """Wall-clock of each run."""
    out: Path | None = None
    """Folder of results, by default runs/compare-BODY; the same command goes on with it."""
    preset: str = "quick"
    """Preset of our agents."""
    episodes: int | None = None
    """Only so many goals of the suite."""
    plan: bool = True
    """Measure our agents with planning at act time too."""


@dataclasses.dataclass(frozen=True)
class Report:
    """Evaluates a run and draws a page of pictures of it."""

    run: tyro.conf.Positional[Path]
    """Run folder."""


@dataclasses.dataclass(frozen=True)
class Render:
    """Films an agent, in real time; the goal is a translucent ghost, what V thinks is below."""

    run: tyro.conf.Positional[Path]
    """Run folder, exported agent, or the name of an agent that comes with everystate."""
    skill: str | None = None
    """A named skill; `everystate skills BODY` lists them."""
    goal: tuple[float, ...] | None = None
    """A state to go to, a number for each component, in the order of `everystate bodies BODY`."""
    explore: bool = False
    """Goals that the agent proposes itself; so it is without --skill and --goal too."""
    out: Path | None = None
    """NAME.mp4 or NAME.gif for a film, NAME.png for a strip of moments. By default an .mp4 named
    after the body and what it does, here."""
    steps: int = 250
    """Control steps of --goal and --explore; a skill has its own."""
    plan: bool = True
    """Act by planning ahead rather than by the policy."""
    seed: int = 0
    """Of where it starts, of the body's noise and of planning."""
    size: tuple[int, int] = (480, 360)
    """Width and height of a frame, in pixels."""


@dataclasses.dataclass(frozen=True)
class Studio:
    """Serves a page on this machine where one watches an agent live and sends it about."""

    run: tyro.conf.Positional[Path] = Path("cartpole")
    """Run folder, also one still training, exported agent, or one that comes with everystate."""
    port: int = 8080
    """Port of the page; 0 takes any that is free."""
    host: str = "127.0.0.1"
    """Address to serve it on, 0.0.0.0 for all networks; one that other machines can reach asks
    for a token, which is printed."""
    seed: int = 0
    """Of where the body starts, its noise, and what surprises it."""


def train(argv: list[str], command: str = "train", run_dir: Path | None = None) -> Path:
    """Train an agent, or go on; returns the folder of the run."""
    named = bool(argv) and not argv[0].startswith("-")
    if not named and "--help" not in argv:
        raise EverystateError("name the body first: everystate train BODY [options]")
    body = argv[0] if named else Train.body
    peek = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    peek.add_argument("--preset", nargs="?")
    name = peek.parse_known_args(argv)[0].preset or Train.preset
    defaults = Train(**dataclasses.asdict(preset(name, body)), preset=name, run_dir=run_dir)
    options = _parse(Train, command, argv, defaults)
    fields = {field.name: getattr(options, field.name) for field in dataclasses.fields(Config)}
    from everystate import training

    progress = "plain" if options.quiet else True
    return training.train(
        fields.pop("body"), preset=name, run_dir=options.run_dir, progress=progress, **fields
    )


def evaluate(argv: list[str]) -> None:
    """Print what a run can reach."""
    options = _parse(Evaluate, "evaluate", argv)
    from everystate import evaluation

    with _working("measuring"):
        result = evaluation.evaluate(
            options.run,
            plan=options.plan,
            goals_file=options.goals,
            episodes=options.episodes,
            skills=options.skills,
            perturb=options.perturb == "grid",
        )
    if options.json:
        print(json.dumps(result))
        return
    _print(evaluation.table(result))
    if options.skills:
        _print(evaluation.skills_table(result))
    if options.perturb:
        _print(evaluation.perturbed_table(result))


def compare(argv: list[str]) -> None:
    """Train and measure several agents side by side."""
    options = _parse(Compare, "compare", argv)
    from everystate import peers

    shared = options.body, options.minutes, options.preset, options.episodes, options.plan
    out = options.out or Path("runs") / f"compare-{Path(options.body).stem}"
    peers.compare(peers.Terms(*shared), options.agents, options.seeds, out)
    print((out / "comparison.md").read_text())
    print(f"in {out}")


def report(argv: list[str]) -> None:
    """Draw the page of a run."""
    options = _parse(Report, "report", argv)
    from everystate import evaluation, viewing

    with _working("measuring, then drawing"):
        page = viewing.report(options.run, evaluation.evaluate(options.run))
    print(page)


def render(argv: list[str]) -> None:
    """Film an agent."""
    options = _parse(Render, "render", argv)
    from everystate import viewing

    with _working("filming"):
        path = viewing.render(
            options.run,
            options.out,
            skill=options.skill,
            goal=options.goal,
            explore=options.explore,
            steps=options.steps,
            plan=options.plan,
            seed=options.seed,
            size=options.size,
        )
    print(path)


def studio(argv: list[str]) -> None:
    """Serve the page of an agent."""
    options = _parse(Studio, "studio", argv)
    from everystate.viewing.studio import studio

    studio(options.run, host=options.host, port=options.port, seed=options.seed)


def demo(argv: list[str]) -> None:
    """Train, evaluate and report on the Ramp Pointmass."""
    run_dir = train(["ramp-pointmass", *argv], "demo", Path("runs/ramp-pointmass-demo"))
    from everystate import evaluation, viewing

    with _working("measuring"):
        result = evaluation.evaluate(run_dir)
    _print(evaluation.table(result))
    print(f"report:      {viewing.report(run_dir, result)}")
    print(f"run:         {run_dir}")
    print(f"all metrics: {run_dir}/metrics.jsonl, and {run_dir}/tensorboard for TensorBoard")
    print(f"in Python:   everystate.load({str(run_dir)!r}).act(observation, goal)")


def bodies(argv: list[str]) -> None:
    """List the bodies: those built in, or the ones named."""
    from everystate import envs

    for name in argv or envs.BODIES:
        print(envs.make(name, 1, 0).describe(), end="\n\n")
    if not argv:
        print("Also the path of any MJCF file, NAME.xml, and MODULE:ID for what a module registers")
        print("with Gymnasium: gymnasium:Pendulum-v1. `everystate bodies NAME` describes it.")


def skills(argv: list[str]) -> None:
    """List the named skills of all bodies that have some, or of the ones named."""
    from everystate.skills import SKILLS, skills_of

    for body in argv or SKILLS:
        print(f"{body}:")
        for name, skill in skills_of(body).items():
            print(f"  {name}: {skill.text}")


COMMANDS = {
    f.__name__: f for f in (train, evaluate, compare, report, render, studio, demo, bodies, skills)
}


def main(argv: list[str] | None = None) -> int:
    """Runs one command and returns its exit code."""
    argv = sys.argv[1:] if argv is None else argv
    warnings.formatwarning = lambda message, *_, **__: f"warning: {message}\n"
    try:
        if not argv or argv[0] in ("-h", "--help"):
            print(__doc__)
        elif argv[0] not in COMMANDS:
            raise EverystateError(f"unknown command {argv[0]!r}: {suggest(argv[0], COMMANDS)}")
        else:
            COMMANDS[argv[0]](argv[1:])
    except EverystateError as error:
        print("error:", " ".join(str(error).split()), file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130
    return 0


def _parse(kind: type, command: str, argv: list[str], default: Any = tyro.MISSING_NONPROP) -> Any:
    """Options by Tyro, but what is wrong with them in one line, with a suggestion."""
    known = {f"--{field.name}".replace("_", "-"): field.type for field in dataclasses.fields(kind)}
    known |= {f"--no-{name[2:]}": bool for name, type_ in known.items() if type_ in (bool, "bool")}
    for argument in argv:
        option = argument.partition("=")[0].replace("_", "-")
        if option.startswith("--") and option not in {*known, "--help"}:
            raise EverystateError(f"unknown option {option}: {suggest(option, known)}")
    said = io.StringIO()
    try:
        with contextlib.redirect_stderr(said):
            return tyro.cli(kind, args=argv, default=default, prog=f"everystate {command}")
    except SystemExit as stop:
        if not stop.code:
            raise
        # Below the title and above the advice, between lines that are drawn.
        lines = [line.strip(" │") for line in said.getvalue().splitlines()[1:]]
        below = itertools.dropwhile(_is_drawn, lines)
        raise EverystateError(
            " ".join(itertools.takewhile(lambda x: not _is_drawn(x), below))
        ) from stop


def _is_drawn(line: str) -> bool:
    return not line.strip("─-╭╮╰╯├┤ ")


@contextlib.contextmanager
def _working(what: str) -> Iterator[None]:
    """Says on a terminal that something takes its time, and how long it has been."""
    from rich.console import Console
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    console = Console(stderr=True)
    columns = SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn()
    quiet = not console.is_terminal
    with Progress(*columns, console=console, transient=True, disable=quiet) as bar:
        bar.add_task(what, total=None)
        yield


def _print(table: Any) -> None:
    from rich.console import Console

    Console().print(table)
