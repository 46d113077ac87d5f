"""Cartpole: the Control Suite's, without its task (Tassa et al. 2018; Zhang 2019).

A cart on a rail of 3.6 m carries a pole that turns right round; the one motor pushes the cart.
The angle of the pole is 0 when it stands up. It begins hanging, nearly at rest, and is never reset.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
from jaxtyping import Float, Shaped

from everystate.envs.joints import JointBody

_XML = Path(__file__).with_name("cartpole.xml")


@dataclass(frozen=True)
class Cartpole(JointBody):
    """State: x of the cart, cosine and sine of the pole's angle, and both velocities."""

    xml: Path = _XML
    frame_skip: int = 4

    name = "cartpole"
    source = "dm_control 1.0.50, suite/cartpole.xml (Apache-2.0)"
    camera = "overview"
    # About what a swing up through the top and a turn a second take.
    nominal: ClassVar = {
        "cart_velocity": (0.0, 2.0),
        "pole_velocity": (0.0, 5.0),
    }

    def initial(self, num: int, rng: np.random.Generator) -> Float[np.ndarray, "envs 5"]:
        """Hanging within 0.1 rad, anywhere on the middle half of the rail, slowly moving."""
        x, angle = rng.uniform(-0.9, 0.9, num), np.pi + rng.uniform(-0.1, 0.1, num)
        slow = rng.normal(0.0, 0.05, (2, num))
        return np.stack([x, np.cos(angle), np.sin(angle), *slow], axis=1)

    def regions(self, observations: Float[np.ndarray, "*n 5"]) -> Shaped[np.ndarray, "*n"]:
        """Upright or hanging, both about at rest, where it can stay; else moving."""
        _, cosine, _, v, w = np.moveaxis(observations, -1, 0)
        still = (np.abs(cosine) > np.cos(np.radians(18))) & (np.abs(v) < 0.5) & (np.abs(w) < 1)
        return np.where(still, np.where(cosine > 0, "upright", "hanging"), "moving")
