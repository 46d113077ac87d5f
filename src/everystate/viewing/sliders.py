"""What the sliders of a goal stand for: components of its state, and features in their place."""

from collections.abc import Collection, Mapping
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Float32
from mujoco import mjtJoint

from everystate.envs import MujocoVectorEnv
from everystate.features import Free, Leaning, features, parts
from everystate.goals import Goal

_FEW = 8
"""So many positions are shown unfolded, whatever they are."""
_FREE = (mjtJoint.mjJNT_FREE, mjtJoint.mjJNT_BALL)

State = Float[np.ndarray, " state"]


class Slider(NamedTuple):
    """One of them; those of a body tell a whole state, and some features besides."""

    name: str
    """Of a component or a feature."""
    unit: str
    low: float
    high: float
    says: tuple[str, ...]
    """The components of the state that it says, alone or with others."""
    besides: bool = False
    """Whether a whole state is told without it: others say the same in other words."""

    @property
    def label(self) -> str:
        """Its name and unit."""
        unit = {"1": "", "deg": " (°)"}.get(self.unit, f" ({self.unit})")
        return self.name + unit

    def excludes(self, other: "Slider") -> bool:
        """Whether a goal cannot ask for both: a feature, and a component that it is made of."""
        alike = (self.says == (self.name,)) == (other.says == (other.name,))
        return not alike and bool(set(self.says) & set(other.says))


def grouped(
    env: MujocoVectorEnv, low: State, high: State
) -> dict[str, tuple[tuple[Slider, ...], bool]]:
    """Sliders under pose, joints and velocities; and which of these begin unfolded.

    Pose is that of what is free to move anywhere, as a torso. An angle stands for its cosine and
    sine, and heading, pitch and roll for the directions of axes.

    Args:
        env: the body.
        low: least value of each component.
        high: largest.
    """
    names = env.state_names
    groups: dict[str, list[Slider]] = {"pose": [], "joints": [], "velocities": []}
    free = _free(env)
    for slider in _sliders(names, env.state_units, low.tolist(), high.tolist()):
        kind = "pose" if slider.says[0].startswith(free) else "joints"
        groups["velocities" if slider.unit.endswith("/s") else kind].append(slider)
    few = len(groups["pose"]) + len(groups["joints"]) <= _FEW
    if not groups["pose"]:
        groups = {"position": groups["joints"], "velocities": groups["velocities"]}
    return {
        title: (tuple(sliders), title in ("pose", "position") or (few and title == "joints"))
        for title, sliders in groups.items()
        if sliders
    }


def _free(env: MujocoVectorEnv) -> tuple[str, ...]:
    """How the names of components begin that are of what is free to move anywhere."""
    joints = [env.model.joint(i) for i in range(env.model.njnt)]
    named = [joint.name for joint in joints if joint.name and joint.type[0] in _FREE]
    named += [p.name for p in parts(env.state_names) if isinstance(p, Free | Leaning)]
    return tuple(f"{name}_" for name in named)


def _sliders(
    names: tuple[str, ...], units: tuple[str, ...], low: list[float], high: list[float]
) -> list[Slider]:
    """In the order of the state; what is told besides comes first, as it is what people ask for."""
    found: dict[str, Slider] = {}
    for feature in features(names).values():
        like, most = feature.like, feature.bound
        ends = (-most, most) if like is None else (low[like], high[like])
        besides = not feature.periodic and len(feature.components) > 1
        found[feature.name] = Slider(feature.name, feature.unit, *ends, feature.components, besides)
    instead = [slider for slider in found.values() if not slider.besides]
    told = {name for slider in instead for name in slider.says}
    ordered = [slider for slider in found.values() if slider.besides]
    for name, unit, least, most in zip(names, units, low, high, strict=True):
        if name in told:
            ordered += [slider for slider in instead if slider.says[0] == name]
        else:
            ordered.append(Slider(name, unit, least, most, (name,)))
    return ordered


def values(state: State, names: tuple[str, ...]) -> dict[str, float]:
    """Of every component and feature of a state, by name."""
    read = {name: float(x) for part in parts(names) for name, x in part.read(state).items()}
    return dict(zip(names, state.tolist(), strict=True)) | read


def goal(
    sliders: Collection[Slider],
    asked: Collection[str],
    given: Mapping[str, float],
    names: tuple[str, ...],
) -> Goal:
    """What sliders ask for: a whole state, if all but those besides matter and no others.

    Args:
        sliders: of the body.
        asked: names of those that matter.
        given: the value of each slider, by name.
        names: of the components of the state.
    """
    if set(asked) != {slider.name for slider in sliders if not slider.besides}:
        return {name: given[name] for name in asked}
    state: Float32[np.ndarray, " state"] = np.zeros(len(names), np.float32)
    for part in parts(names):
        own = [feature.name for feature in part.features if feature.name in asked]
        state = part.set(state, {name: np.asarray(given[name], np.float32) for name in own})
    # After the features: a heading that is set turns the velocity with it.
    for i, name in enumerate(names):
        if name in asked:
            state[i] = given[name]
    return state


def matter(sliders: Collection[Slider], asked: Goal, names: tuple[str, ...]) -> set[str]:
    """Names of the sliders that say what a goal asks for."""
    if isinstance(asked, Mapping):
        wanted = set(asked)
    else:
        numbers: Any = np.asarray(asked, np.float32)
        wanted = {name for name, x in zip(names, numbers, strict=True) if not np.isnan(x)}
    return {
        slider.name
        for slider in sliders
        if slider.name in wanted or (not slider.besides and wanted & set(slider.says))
    }
