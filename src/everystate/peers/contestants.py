"""Who can be compared: our agent, by its own goals and by those others would choose, and peers."""

from collections.abc import Sequence
from dataclasses import dataclass
from importlib.util import find_spec

from everystate.errors import EverystateError, suggest
from everystate.peers.settings import SETTINGS, PeerSettings


@dataclass(frozen=True)
class Contestant:
    """How an agent comes about; one with neither options nor settings does not learn."""

    text: str
    options: tuple[str, ...] | None = None
    """Of `everystate train`; None for an agent that is not ours."""
    settings: PeerSettings | None = None
    """Of its learning; None for one that is not of Stable-Baselines3."""


ALWAYS = ("nothing", "random")
"""Part of every comparison: what an agent is worth that has learned nothing."""


def _peer(settings: PeerSettings) -> Contestant:
    library = {"sac": "Stable-Baselines3", "tqc": "sb3-contrib"}[settings.algorithm]
    dense = ", dense reward" if settings.reward == "dense" else ""
    free = "" if settings.resets else ", without resets"
    text = f"{settings.algorithm.upper()} with hindsight, of {library}{dense}{free}"
    return Contestant(text, settings=settings)


CONTESTANTS = {
    "ours": Contestant("our agent as `everystate train` makes it", ()),
    "ours-least-likely": Contestant(
        "the least likely of 20 states decoded from f (4.1)", ("--goals", "imagined", "--m", "20")
    ),
    "ours-density": Contestant("states decoded from f", ("--goals", "imagined", "--m", "1")),
    "ours-visited": Contestant("visited states, any alike", ("--goals", "any-visited", "--m", "1")),
    "ours-skew-fit": Contestant(
        "visited states by p_f^-0.5, as Skew-Fit weighs them", ("--goals", "visited", "--m", "1")
    ),
    "ours-mega": Contestant(
        "the least likely of 100 visited states, as MEGA has it",
        ("--goals", "any-visited", "--m", "100"),
    ),
    "ours-uniform": Contestant(
        "states of a box around all there are, as an oracle would",
        ("--goals", "uniform", "--m", "1"),
    ),
    **{name: _peer(settings) for name, settings in SETTINGS.items()},
    "nothing": Contestant("no action at all: zero at every step"),
    "random": Contestant("uniformly random actions"),
}


def complete(names: Sequence[str]) -> list[str]:
    """The agents once each, and those of every comparison after them.

    Raises:
        EverystateError: one is not known, or its library is not installed, or there is none.
    """
    if not names:
        raise EverystateError(f"no agents to compare: name some of {', '.join(CONTESTANTS)}")
    for name in names:
        if name not in CONTESTANTS:
            raise EverystateError(f"no agent {name!r} to compare: {suggest(name, CONTESTANTS)}")
        if name in SETTINGS and not find_spec("sb3_contrib"):
            raise EverystateError(
                f"{name} is not installed: pip install stable-baselines3 sb3-contrib, which are"
                " everystate's extra `peers`, or leave it out of --agents"
            )
    return [*dict.fromkeys(n for n in names if n not in ALWAYS), *ALWAYS]
