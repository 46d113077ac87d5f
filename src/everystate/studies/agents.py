"""What can be compared: our agent, by its own goals and by those others would choose, and peers."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any

from everystate.errors import EverystateError, suggest
from everystate.peers.settings import SETTINGS, PeerSettings


@dataclass(frozen=True)
class Compared:
    """How an agent comes about; one with neither options nor settings does not learn."""

    text: str
    options: Mapping[str, Any] | None = None
    """Fields of the config; None for an agent that is not ours."""
    settings: PeerSettings | None = None
    """Of its learning; None for one that is not of Stable-Baselines3."""


ALWAYS = ("nothing", "random")
"""Part of every comparison: what an agent is worth that has learned nothing."""


def _peer(settings: PeerSettings) -> Compared:
    library = {"sac": "Stable-Baselines3", "tqc": "sb3-contrib"}[settings.algorithm]
    dense = ", dense reward" if settings.reward == "dense" else ""
    free = "" if settings.resets else ", without resets"
    text = f"{settings.algorithm.upper()} with hindsight, of {library}{dense}{free}"
    return Compared(text, settings=settings)


AGENTS = {
    "ours": Compared("our agent as `everystate train` makes it", {}),
    "ours-least-likely": Compared(
        "the least likely of 20 states decoded from f (4.1)", {"goals": "imagined", "m": 20}
    ),
    "ours-density": Compared("states decoded from f", {"goals": "imagined", "m": 1}),
    "ours-visited": Compared("visited states, any alike", {"goals": "any-visited", "m": 1}),
    "ours-skew-fit": Compared(
        "visited states by p_f^-0.5, as Skew-Fit weighs them", {"goals": "visited", "m": 1}
    ),
    "ours-mega": Compared(
        "the least likely of 100 visited states, as MEGA has it", {"goals": "any-visited", "m": 100}
    ),
    "ours-uniform": Compared(
        "states of a box around all there are, as an oracle would", {"goals": "uniform", "m": 1}
    ),
    **{name: _peer(settings) for name, settings in SETTINGS.items()},
    "nothing": Compared("no action at all: zero at every step"),
    "random": Compared("uniformly random actions"),
}


def complete(names: Sequence[str]) -> list[str]:
    """The agents once each, and those of every comparison after them.

    Raises:
        EverystateError: one is not known, or its library is not installed, or there is none.
    """
    if not names:
        raise EverystateError(f"no agents to compare: name some of {', '.join(AGENTS)}")
    for name in names:
        if name not in AGENTS:
            raise EverystateError(f"no agent {name!r} to compare: {suggest(name, AGENTS)}")
        if name in SETTINGS and not find_spec("sb3_contrib"):
            raise EverystateError(
                f"{name} is not installed: pip install stable-baselines3 sb3-contrib, which are"
                " everystate's extra `peers`, or leave it out of --agents"
            )
    return [*dict.fromkeys(n for n in names if n not in ALWAYS), *ALWAYS]
