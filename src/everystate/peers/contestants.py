"""Who can be compared: our agent, by its own goals and by those others would choose, and peers."""

from collections.abc import Sequence
from importlib.util import find_spec
from typing import NamedTuple

from everystate.errors import EverystateError, suggest


class Contestant(NamedTuple):
    """How an agent comes about."""

    text: str
    options: tuple[str, ...] | None = None
    """Of `everystate train`; None for an agent that is not ours."""


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
    "sac-her": Contestant("SAC with hindsight, of Stable-Baselines3"),
    "tqc-her": Contestant("TQC with hindsight, of sb3-contrib"),
    "random": Contestant("uniformly random actions"),
}


def require(names: Sequence[str]) -> None:
    """Complains of agents that are not known, or whose library is not installed, and of none."""
    if not names:
        raise EverystateError(f"no agents to compare: name some of {', '.join(CONTESTANTS)}")
    for name in names:
        if name not in CONTESTANTS:
            raise EverystateError(f"no agent {name!r} to compare: {suggest(name, CONTESTANTS)}")
        if name.endswith("-her") and not find_spec("sb3_contrib"):
            raise EverystateError(
                f"{name} is not installed: pip install stable-baselines3 sb3-contrib, which are"
                " everystate's extra `peers`, or leave it out of --agents"
            )
