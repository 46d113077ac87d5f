"""The options of the commands."""

import dataclasses
from pathlib import Path
from typing import Literal

import tyro

from everystate.config import Config
from everystate.errors import EverystateError


@dataclasses.dataclass(frozen=True)
class Train(Config):
    """Trains an agent; the same command goes on with a run that was interrupted."""

    body: tyro.conf.Positional[str] = "ramp-pointmass"
    """Body to learn; `everystate bodies` lists them."""
    preset: str = "quick"
    """Preset: quick (for two cores), paper, literal (paper without stabilisers) or test. It sets
    the defaults of the options below."""
    config: Path | None = None
    """TOML file that sets the body, the preset and any of the options below, as config.toml in the
    folder of a run; what is given on the command line counts for more."""
    run_dir: Path | None = None
    """Folder of the run, by default runs/BODY-PRESET-seedSEED; with --config the name of its file
    stands for PRESET."""
    quiet: bool = False
    """A plain line every few epochs instead of a progress bar."""
    track: Literal["wandb", "trackio"] | None = None
    """Send the metrics to this tracker too, which must be installed; its own environment variables
    set it up, as WANDB_MODE=offline."""
    ray_address: str | None = None
    """Head of the Ray cluster for --collectors, HOST:PORT, or auto for this machine's; by default
    Ray is started on this machine, and stopped in the end."""
    hosts: int = 1
    """Processes that train together, one on each host, all started by the same command; --devices
    counts the devices of all."""
    coordinator: str | None = None
    """HOST:PORT of the first of them, free there and reachable from all; SLURM and others tell."""
    host_id: int | None = None
    """Which of them this is, from 0; the first has the run's folder. SLURM and others tell."""


@dataclasses.dataclass(frozen=True)
class Evaluate:
    """Measures what an agent can reach, by region; how it explored; and how safe it is."""

    run: tyro.conf.Positional[Path]
    """Run folder, exported agent, or the name of an agent that comes with everystate."""
    json: bool = False
    """The last line is one JSON object."""
    out: Path | None = None
    """Also write the result to this file, which must not exist."""
    suite: tuple[str, ...] = ()
    """Suites of the body, as rest and motion, or paths of your own (.json, in the form of those in
    everystate/evaluation/suites); by default all that it has."""
    split: Literal["report", "tune"] = "report"
    """Which half of its goals: tune while you choose settings, report for what you publish."""
    episodes: int | None = None
    """Only so many goals of each suite, evenly taken."""
    plan: bool = False
    """Measure planning at act time too, which takes its time."""
    skills: bool = False
    """Measure the named skills of the body too."""
    perturb: Literal["grid"] | None = None
    """Measure it in worlds of other masses, motors and noise too: worst, and the worst tenth."""


@dataclasses.dataclass(frozen=True)
class Score:
    """Scores the recorded ways of anybody's agent to the goals of a suite; docs/benchmark.md."""

    file: tyro.conf.Positional[Path]
    """Recording, as everystate.benchmark.record and save write it."""
    json: bool = False
    """The last line is one JSON object."""
    out: Path | None = None
    """Also write the result to this file, which must not exist."""
    suite: Path | None = None
    """The suite's file, if it is one of your own."""


@dataclasses.dataclass(frozen=True)
class Compare:
    """Trains agents on one body for the same time, each on one core, and measures them alike.

    Agents: ours (as `everystate train` makes it), ours-least-likely, ours-density, ours-visited,
    ours-skew-fit, ours-mega and ours-uniform (by other choices of goals), sac-her, tqc-her,
    sac-her-zoo, tqc-her-zoo and tqc-her-zoo-push, each of these also as NAME-dense and
    NAME-no-reset, and, named or not, nothing and random.
    """

    body: tyro.conf.Positional[str]
    """Body to learn; `everystate bodies` lists them."""
    agents: tuple[str, ...] = ("ours", "sac-her")
    """Whom to compare."""
    seeds: int = 5
    """Runs of each, of seeds 0, 1, and so on."""
    minutes: float = 10.0
    """Wall-clock of each run."""
    workers: int | None = None
    """Runs that are made at a time, by default as many as there are cores."""
    out: Path | None = None
    """Folder of results, by default runs/compare-BODY; the same command goes on with it."""
    preset: str = "quick"
    """Preset of our agents."""
    episodes: int | None = None
    """Only so many goals of the suite."""
    plan: bool = False
    """Measure our agents with planning at act time too, which takes its time."""
    rescore: bool = False
    """Train nothing; measure again all agents of the comparison in --out, from what was kept of
    them."""


@dataclasses.dataclass(frozen=True)
class Sweep:
    """Trains and measures the runs that a TOML file names, each on one core; docs/scaling.md."""

    file: tyro.conf.Positional[Path]
    """Conditions and seeds, as everystate/studies/plan.py explains."""
    out: Path | None = None
    """Folder of results, by default runs/sweep-FILE; the same command goes on with it."""
    workers: int | None = None
    """Runs that are made at a time, by default as many as there are cores."""
    ray_address: str | None = None
    """A Ray cluster to make them on, HOST:PORT or auto; by default they are made here."""
    table_only: bool = False
    """Train nothing; write tables and figure of what there is, unfinished runs' readings too."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Driven:
    """What acts."""

    plan: tyro.conf.FlagCreatePairsOff[bool] = False
    """Act by planning ahead: a search through the learned dynamics at every step."""
    no_plan: tyro.conf.FlagCreatePairsOff[bool] = False
    """Act by the policy alone. Without either, by what the agent says drives it best."""

    def __post_init__(self) -> None:
        if self.plan and self.no_plan:
            raise EverystateError("give one of --plan and --no-plan")

    @property
    def planning(self) -> bool | None:
        """Whether to plan; None: as the agent says."""
        return self.plan if self.plan or self.no_plan else None


@dataclasses.dataclass(frozen=True)
class Report(Driven):
    """Evaluates a run or an agent and draws a page of pictures of it.

    With planning, both that and the policy alone are measured.
    """

    run: tyro.conf.Positional[Path]
    """Run folder, exported agent, or the name of an agent that comes with everystate."""
    out: Path | None = None
    """Folder of the page, by default RUN/report; an agent without its run needs one."""
    episodes: int | None = None
    """Only so many goals of each suite, evenly taken."""


@dataclasses.dataclass(frozen=True)
class Render(Driven):
    """Films an agent, in real time; the goal is a translucent ghost, what V thinks is below."""

    run: tyro.conf.Positional[Path]
    """Run folder, exported agent, or the name of an agent that comes with everystate."""
    skill: str | None = None
    """A named skill; `everystate skills BODY` lists them."""
    goal: tuple[str, ...] | None = None
    """A state to go to, a number for each component in the order of `everystate bodies BODY`; or
    what you ask of it, and nothing more, as in height=0.6 forward_velocity=0.5."""
    explore: bool = False
    """Goals that the agent proposes itself; so it is without --skill and --goal too."""
    out: Path | None = None
    """NAME.mp4 or NAME.gif for a film, NAME.png for a strip of moments. By default an .mp4 named
    after the body and what it does, here."""
    steps: int = 250
    """Control steps of --goal and --explore; a skill has its own."""
    seed: int = 0
    """Of where it starts, of the body's noise and of planning."""
    size: tuple[int, int] = (480, 360)
    """Width and height of a frame, in pixels."""


@dataclasses.dataclass(frozen=True)
class Studio(Driven):
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


@dataclasses.dataclass(frozen=True)
class Export:
    """Writes the agent of a run to a folder, or to one file to share: NAME.zip.

    Or its policy alone, for programs without JAX: NAME.onnx, or NAME.npz for NumPy.
    """

    run: tyro.conf.Positional[Path]
    """Run folder, exported agent, or the name of an agent that comes with everystate."""
    out: tyro.conf.Positional[Path]
    """Folder, NAME.zip, NAME.onnx or NAME.npz to write to; it must not exist."""
    half: bool = False
    """Matrices of the agent as float16, for half the size; it then acts a little differently."""


@dataclasses.dataclass(frozen=True)
class Bodies:
    """Lists the bodies that are built in and robots by name, or describes those named."""

    body: tyro.conf.Positional[tuple[str, ...]] = ()
    """Bodies to describe: names, robot:NAME, paths of MJCF files, or MODULE:ID."""
    body_options: tuple[str, ...] = ()
    """Their options, each as name=value: travel=true, sensors=true."""


@dataclasses.dataclass(frozen=True)
class Completion:
    """Prints a script by which a shell completes commands, options and their choices.

    In ~/.bashrc or ~/.zshrc: eval "$(everystate completion bash)", or zsh.
    """

    shell: tyro.conf.Positional[Literal["bash", "zsh"]]
    """For which shell."""


@dataclasses.dataclass(frozen=True)
class Skills:
    """Lists the named skills of all bodies that have some."""

    body: tyro.conf.Positional[tuple[str, ...]] = ()
    """Only those of these bodies."""
