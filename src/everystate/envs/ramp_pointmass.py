"""Ramp Pointmass (Zhang 2019, section 5.1 and Fig. 3): a ramp that one must climb and can fall off.

Floor, walls, a ramp along the east wall entered only at its southern foot, and a ledge along the
whole north wall reached only by the ramp. The east and north walls hold the mass; off the west side
of the ramp or the south side of the ledge it falls back to the floor and has lost its climb.

The state is x, y. One control step is: velocity zero, 8 physics steps of 7.5 ms under the motors,
then, only for a mass in the air, 50 more with the motors off (free fall from 0.5 m takes 43). A
mass that hangs half over an edge is moved clear of it first. What physics leaves over (contacts are
soft) is removed by setting the mass down deterministically: inside the walls, exactly on the
surface below, at rest. So (x, y) is the whole state after every control step. Up the slope a step
covers about 0.077 m of the map instead of 0.1; an idle mass slides down by about 0.008 m.
"""

from dataclasses import dataclass
from pathlib import Path

import mujoco.batch
import numpy as np
from jaxtyping import Bool, Float, Shaped

from everystate.envs.body import Body
from everystate.errors import EverystateError

ARENA = 1.0  # x and y of the centre of the mass lie in [-1, 1]
RADIUS = 0.05
RAMP_WEST = 0.5  # the ramp reaches from here to the east wall
RAMP_FOOT = -0.6  # y where the ramp begins, at z = 0
LEDGE_SOUTH = 0.6  # y where the ramp ends and the ledge begins
LEDGE_HEIGHT = 0.5
FALL_DROP = 0.1  # a loss of height within one control step that only a fall can cause
_RELEASE_STEPS = 50


def height(xy: Float[np.ndarray, "*n 2"]) -> Float[np.ndarray, "*n"]:
    """Height z of the surface below (x, y), in metres: 0 on the floor to 0.5 on the ledge."""
    x, y = xy[..., 0], xy[..., 1]
    climb = np.clip((y - RAMP_FOOT) / (LEDGE_SOUTH - RAMP_FOOT), 0.0, 1.0) * LEDGE_HEIGHT
    return np.where((x >= RAMP_WEST) | (y >= LEDGE_SOUTH), climb, 0.0)


def region(xy: Float[np.ndarray, "*n 2"]) -> Shaped[np.ndarray, "*n"]:
    """Which of "floor", "ramp" and "ledge" lies below (x, y)."""
    x, y = xy[..., 0], xy[..., 1]
    on_ramp = (x >= RAMP_WEST) & (y > RAMP_FOOT)
    return np.where(y >= LEDGE_SOUTH, "ledge", np.where(on_ramp, "ramp", "floor"))


def fell(
    before: Float[np.ndarray, "*n 2"], after: Float[np.ndarray, "*n 2"]
) -> Bool[np.ndarray, "*n"]:
    """Whether one control step lost more than 0.1 m of height; driving down costs at most 0.07."""
    return np.asarray(height(before) - height(after) > FALL_DROP)


def set_down(xy: Float[np.ndarray, "*n 2"]) -> Float[np.ndarray, "*n 2"]:
    """The nearest place where the ball can rest: inside the walls and not half over an edge."""
    x, y = np.moveaxis(np.clip(xy, -ARENA, ARENA), -1, 0)
    over_ramp_edge = (x > RAMP_WEST - RADIUS) & (x < RAMP_WEST) & (y > RAMP_FOOT)
    over_ledge_edge = (y > LEDGE_SOUTH - RADIUS) & (y < LEDGE_SOUTH) & (x < RAMP_WEST)
    beside_ramp = np.where(over_ramp_edge & (y < LEDGE_SOUTH), RAMP_WEST - RADIUS, x)
    below_ledge = np.where(over_ledge_edge, LEDGE_SOUTH - RADIUS, y)
    return np.stack([beside_ramp, below_ledge], axis=-1)


@dataclass(frozen=True)
class RampPointmass(Body):
    """The body, with the noise its actions suffer.

    Every component of every action gets its own normal noise of `noise_sigma`, truncated to
    [-noise_bound, noise_bound], in units of the action (1 moves the mass 0.1 m on the floor). It is
    added after clipping and not clipped again, so that its spread does not depend on the action.
    """

    noise_sigma: float = 0.3
    noise_bound: float = 0.6

    name = "ramp-pointmass"
    xml = Path(__file__).with_name("ramp_pointmass.xml")
    source = "our own, after Zhang (2019), Fig. 3"
    frame_skip = 8
    state_names = ("x", "y")
    state_units = ("m", "m")
    centre = (0.0, 0.0)
    spread = (0.6, 0.6)
    low = (-ARENA, -ARENA)
    high = (ARENA, ARENA)
    camera = "overview"
    ghost_scale = 1.8

    def __post_init__(self) -> None:
        for field, value in (("noise_sigma", self.noise_sigma), ("noise_bound", self.noise_bound)):
            # The fence and the walls were tested with displacements of up to 0.2 m a control step.
            if not 0.0 <= value <= 1.0:
                raise EverystateError(f"{field} is {value}: choose a number from 0 to 1")

    def initial(self, num: int, rng: np.random.Generator) -> Float[np.ndarray, "envs 2"]:
        """Uniform on the open floor, west of the ramp and south of the ledge."""
        east, north = RAMP_WEST - 2 * RADIUS, LEDGE_SOUTH - 2 * RADIUS
        return rng.uniform([-ARENA, -ARENA], [east, north], size=(num, 2))

    def observe(
        self, qpos: Float[np.ndarray, "envs 3"], qvel: Float[np.ndarray, "envs 3"]
    ) -> Float[np.ndarray, "envs 2"]:
        """x, y of the centre of the mass in metres."""
        return qpos[:, :2]

    def place(
        self, observations: Float[np.ndarray, "envs 2"]
    ) -> tuple[Float[np.ndarray, "envs 3"], Float[np.ndarray, "envs 3"]]:
        """At rest on the surface; places where no ball can rest move to the nearest that can."""
        xy = set_down(observations)
        qpos = np.concatenate([xy, height(xy)[:, None]], axis=1)
        return qpos, np.zeros_like(qpos)

    def drive(
        self, actions: Float[np.ndarray, "envs 2"], rng: np.random.Generator
    ) -> Float[np.ndarray, "envs 2"]:
        """Actions plus truncated-normal noise, drawn by inverting its distribution function."""
        if self.noise_sigma == 0.0 or self.noise_bound == 0.0:
            return actions
        from scipy.special import ndtr, ndtri  # which take long to import

        tail = ndtr(-self.noise_bound / self.noise_sigma)
        noise = self.noise_sigma * ndtri(rng.uniform(tail, 1.0 - tail, size=actions.shape))
        return actions + np.clip(noise, -self.noise_bound, self.noise_bound)

    def finish(self, batch: mujoco.batch.Batch) -> None:
        """Lets masses in the air fall, then sets every mass down at rest (see the module)."""
        qpos, qvel = batch.bind("qpos"), batch.bind("qvel")
        qvel[:] = 0.0
        # A mass that drives down the slope or hops at its foot leaves it by centimetres: set down.
        airborne = np.flatnonzero(qpos[:, 2] - height(qpos[:, :2]) > FALL_DROP)
        if airborne.size:
            # Clear of the edge it hangs on; a ball balanced there would take long to slide off.
            qpos[airborne, :2] = set_down(qpos[airborne, :2])
            batch.bind("ctrl")[airborne] = 0.0
            batch.step(ids=airborne, nstep=_RELEASE_STEPS)
        qpos[:], qvel[:] = self.place(qpos[:, :2])

    def regions(self, observations: Float[np.ndarray, "*n 2"]) -> Shaped[np.ndarray, "*n"]:
        """Which of "floor", "ramp" and "ledge" each state lies on."""
        return region(observations)

    def scored(self, observations: Float[np.ndarray, "*n 2"]) -> Float[np.ndarray, "*n 3"]:
        """x, y and the derived z: being below the ledge does not count as reaching it."""
        return np.concatenate([observations, height(observations)[..., None]], axis=-1)

    def falls(
        self, before: Float[np.ndarray, "*n 2"], after: Float[np.ndarray, "*n 2"]
    ) -> Bool[np.ndarray, "*n"]:
        """Climbs lost within one control step."""
        return fell(before, after)
