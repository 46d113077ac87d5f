"""What people ask of a body that its state says only in other words: heading, pitch, pole angle.

Such a feature is read off states, and can be set in them: the state that is nearest in kind, with
the feature as asked. Bodies have them by the names of their components: a body that moves freely
(`torso_z`, `torso_xx`, ..., `torso_wz`; or without the way it faces `base_z`, `base_upx`, ...,
`base_wz`) and a joint that turns right round (`cos_pole`, `sin_pole`). Both directions take NumPy's
and JAX's arrays alike.
"""

from collections.abc import Sequence

from everystate.features.feature import Feature, Part, Turning
from everystate.features.free import Free, Leaning

__all__ = ["Feature", "Free", "Leaning", "Part", "features", "parts"]


def parts(state_names: Sequence[str]) -> tuple[Part, ...]:
    """The parts of a body that have features, from the names of its state's components."""
    at = {name: i for i, name in enumerate(state_names)}
    free = []
    for ending, columns, kind in (("xx", ("x", "y"), Free), ("upx", ("up",), Leaning)):
        for name in (n.removesuffix(f"_{ending}") for n in at if n.endswith(f"_{ending}")):
            needed = [f"{name}_{kin}{axis}" for kin in (*columns, "v", "w") for axis in "xyz"]
            if all(n in at for n in (f"{name}_z", *needed)):
                begins = (f"{name}_z", f"{name}_{ending}", f"{name}_vx", f"{name}_wx")
                free.append((kind, name, [at[n] for n in begins]))
    found: list[Part] = [
        kind(name, "" if len(free) == 1 else f"{name}_", *where) for kind, name, where in free
    ]
    for name in (n.removeprefix("cos_") for n in at if n.startswith("cos_")):
        if at.get(f"sin_{name}") == at[f"cos_{name}"] + 1:
            found.append(Turning(name, at[f"cos_{name}"]))
    return tuple(part for part in found if not any(f.name in at for f in part.features))


def features(state_names: Sequence[str]) -> dict[str, Feature]:
    """All features of a body, by name."""
    return {f.name: f for part in parts(state_names) for f in part.features}
