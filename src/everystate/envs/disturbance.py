"""How a world may differ from what its model says: noise, slow hands, other masses and motors."""

from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Float

from everystate.errors import EverystateError


@dataclass(frozen=True)
class Disturbance:
    """How the world differs from what the model says; all off by default."""

    action_noise: float = 0.0
    """Standard deviation of noise on every action component, which is then clipped to [-1, 1]."""
    sensor_noise: float = 0.0
    """Standard deviation of noise on every observation, in units of `spread`."""
    action_repeat: int = 1
    """Control steps for which one action is kept."""
    mass: float = 1.0
    """Factor on all masses and inertias (MuJoCo models)."""
    friction: float = 1.0
    """Factor on all friction: of contacts, and in joints (MuJoCo models)."""
    force: float = 1.0
    """Factor on what the motors give (MuJoCo models)."""
    push: float = 0.0
    """Speed (m/s) that a push gives the body as a whole, about once a second, from a random side
    (our MuJoCo bodies)."""

    def __post_init__(self) -> None:
        if not (isinstance(self.action_repeat, int) and 1 <= self.action_repeat <= 1000):
            raise EverystateError(f"action_repeat is {self.action_repeat!r}: choose 1 to 1000")
        for name in ("action_noise", "sensor_noise", "push"):
            if not 0.0 <= getattr(self, name) <= 10.0:
                raise EverystateError(f"{name} is {getattr(self, name)}: choose 0 to 10")
        for name in ("mass", "friction", "force"):
            if not 0.01 <= getattr(self, name) <= 100.0:
                raise EverystateError(f"{name} is {getattr(self, name)}: choose 0.01 to 100")

    @property
    def changes_model(self) -> bool:
        """Whether `perturb` has anything to do."""
        return not self.mass == self.friction == self.force == 1.0

    def perturb(self, model: mujoco.MjModel) -> None:
        """Changes a model's masses, friction and motors, and all that follows from them."""
        if not self.changes_model:
            return
        model.body_mass[:] *= self.mass
        model.body_inertia[:] *= self.mass
        model.geom_friction[:] *= self.friction
        model.pair_friction[:] *= self.friction
        model.dof_frictionloss[:] *= self.friction
        # A servo's gear is also the unit of its targets.
        servo = model.actuator_biastype == mujoco.mjtBias.mjBIAS_AFFINE
        model.actuator_gear[~servo] *= self.force
        for of_servo in (model.actuator_gainprm, model.actuator_biasprm):
            of_servo[servo, :3] *= self.force
        model.actuator_forcerange[servo] *= self.force
        mujoco.mj_setConst(model, mujoco.MjData(model))

    def pushes(
        self, model: mujoco.MjModel, num: int, seconds: float, rng: np.random.Generator
    ) -> Float[np.ndarray, "n body 6"]:
        """Forces on every part of so many bodies for a control step that takes `seconds`.

        At the heaviest part that moves, level, at 1 Hz on average.
        """
        forces = np.zeros((num, model.nbody, 6))
        moving = np.where(model.body_weldid > 0, model.body_mass, 0.0)
        angle, pushed = rng.uniform(-np.pi, np.pi, num), rng.random(num) < seconds
        size = pushed * self.push * moving.sum() / seconds
        at = int(moving.argmax())
        forces[:, at, 0], forces[:, at, 1] = size * np.cos(angle), size * np.sin(angle)
        return forces
