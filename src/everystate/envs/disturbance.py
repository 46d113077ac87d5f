"""How a world may differ from what its model says: noise, slow hands, other masses and motors."""

from dataclasses import dataclass

import mujoco

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

    def __post_init__(self) -> None:
        if not (isinstance(self.action_repeat, int) and 1 <= self.action_repeat <= 1000):
            raise EverystateError(f"action_repeat is {self.action_repeat!r}: choose 1 to 1000")
        for name in ("action_noise", "sensor_noise"):
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
        model.actuator_gear[:] *= self.force
        mujoco.mj_setConst(model, mujoco.MjData(model))
