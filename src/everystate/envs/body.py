"""What the batched stepper must know about a body: one small class per MuJoCo model."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from pathlib import Path

import mujoco
import mujoco.batch
import numpy as np
from jaxtyping import Bool, Float, Shaped

from everystate.errors import EverystateError

FLOOR = (0.86, 0.87, 0.89, 1.0)
_BODY = (0.30, 0.48, 0.70, 1.0)
"""Colours of what has none of its own."""


class Body(ABC):
    """A MuJoCo model, how it is driven, and what of it is observed.

    Subclasses are frozen dataclasses whose fields are the body's options: everything that changes
    during a run lives in the stepper. `centre` and `spread` are nominal:
    `(observation - centre) / spread` is about [-1, 1] or of unit standard deviation over the states
    the body can reach; where they are NaN the stepper measures them under random actions.
    """

    name: str
    xml: Path
    source: str
    """Where the model came from, for `everystate bodies`."""
    frame_skip: int
    """Physics steps per control step."""
    state_names: tuple[str, ...]
    state_units: tuple[str, ...]
    centre: tuple[float, ...]
    spread: tuple[float, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]
    camera: str | int = -1
    """A camera of the model by its name, or -1 for a view of all that the joints can reach."""
    unseen: Sequence[int] = ()
    """Where in qpos x lies, with y after it, of what travels without observing where it is."""
    horizontal: tuple[tuple[int, int], ...] = ()
    """See `BodyVectorEnv`."""
    ghost_scale: float = 1.0
    """A goal's ghost is drawn this much larger, to be seen around a body that has reached it."""

    def load(self) -> mujoco.MjModel:
        """The compiled model, a new one each time."""
        return load_model(self.xml)

    @abstractmethod
    def initial(self, num: int, rng: np.random.Generator) -> Float[np.ndarray, "envs state"]:
        """Observations to start from."""

    @abstractmethod
    def observe(
        self, qpos: Float[np.ndarray, "envs nq"], qvel: Float[np.ndarray, "envs nv"]
    ) -> Float[np.ndarray, "envs state"]:
        """What the agent sees of a physics state."""

    @abstractmethod
    def place(
        self, observations: Float[np.ndarray, "envs state"]
    ) -> tuple[Float[np.ndarray, "envs nq"], Float[np.ndarray, "envs nv"]]:
        """A full physics state (qpos, qvel) that is observed as given; also draws goals."""

    def carried(
        self, observations: Float[np.ndarray, "steps state"], heading: float = 0.0
    ) -> Float[np.ndarray, "steps gone"]:
        """Where a path has led what is `unseen`, by which `place` is off: x, y and heading of each.

        In metres and radians from its first state on, in which it faced `heading`; the heading is 0
        throughout where it is observed.
        """
        return np.zeros((len(observations), 0))

    def moved(
        self, qpos: Float[np.ndarray, "n nq"], gone: Float[np.ndarray, "n gone"]
    ) -> Float[np.ndarray, "n nq"]:
        """Poses of `place`, put to where `carried` says."""
        return qpos

    def drive(
        self, actions: Float[np.ndarray, "envs action"], rng: np.random.Generator
    ) -> Float[np.ndarray, "envs nu"]:
        """Motor signals of one control step, from actions in [-1, 1] and noise of its own."""
        return actions

    def finish(self, batch: mujoco.batch.Batch) -> None:
        """Whatever a control step still has to do after its `frame_skip` physics steps."""
        return

    def regions(self, observations: Float[np.ndarray, "*n state"]) -> Shaped[np.ndarray, "*n"]:
        """The name of the part of the world each state lies in; success is told by part."""
        return np.full(observations.shape[:-1], "all")

    def scored(self, observations: Float[np.ndarray, "*n state"]) -> Float[np.ndarray, "*n scored"]:
        """What a success metric compares between a state and its goal."""
        return observations

    def falls(
        self, before: Float[np.ndarray, "*n state"], after: Float[np.ndarray, "*n state"]
    ) -> Bool[np.ndarray, "*n"]:
        """Whether the control step from `before` to `after` was a fall."""
        return np.zeros(before.shape[:-1], dtype=bool)


def load_model(xml: Path) -> mujoco.MjModel:
    """The model in an MJCF file.

    Raises:
        EverystateError: the file is missing, does not compile, or has no joint or no motor.
    """
    if not xml.is_file():
        raise EverystateError(f"there is no MJCF file {xml}: give the path of one")
    try:
        spec = mujoco.MjSpec.from_file(str(xml))
        _light(spec)
        model = spec.compile()
    except ValueError as error:
        raise EverystateError(f"{xml} does not compile: {error}") from error
    if model.nv == 0:
        raise EverystateError(f"{xml} has no joint: nothing in it can move")
    if model.nu == 0:
        raise EverystateError(f"{xml} has no actuator: give its <actuator> at least one motor")
    # A body that blows up must be seen, not silently put back where it was built.
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
    return model


def _light(spec: mujoco.MjSpec) -> None:
    """Gives a file that says nothing of its looks a white sky, light and colours."""
    sky = mujoco.mjtTexture.mjTEXTURE_SKYBOX
    if not any(texture.type == sky for texture in spec.textures):
        flat, white = mujoco.mjtBuiltin.mjBUILTIN_FLAT, [1, 1, 1]
        spec.add_texture(
            name="everystate_sky",
            type=sky,
            builtin=flat,
            rgb1=white,
            rgb2=white,
            width=16,
            height=96,
        )
    headlight, untouched = spec.visual.headlight, mujoco.MjSpec().visual.headlight
    if not spec.lights and np.array_equal(headlight.ambient, untouched.ambient):
        headlight.ambient, headlight.diffuse = [0.5, 0.5, 0.5], [0.2, 0.2, 0.2]
        spec.worldbody.add_light(
            name="everystate_light",
            type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
            castshadow=False,
            dir=[0.3, 0.5, -1],
            diffuse=[0.5, 0.5, 0.5],
        )
    plane, grey = mujoco.mjtGeom.mjGEOM_PLANE, spec.default.geom.rgba
    for geom in spec.geoms:
        if not geom.material and np.array_equal(geom.rgba, grey):
            geom.rgba = FLOOR if geom.type == plane else _BODY
