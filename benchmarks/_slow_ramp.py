"""The Ramp Pointmass as slow as a real simulator, for benchmarks/scale.py."""

import time
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from everystate.envs import RampPointmass


@dataclass(frozen=True)
class SlowRamp(RampPointmass):
    """Each body takes its time at each control step, one after the other."""

    wait_ms: float = 20.0

    def drive(
        self, actions: Float[np.ndarray, "envs action"], rng: np.random.Generator
    ) -> Float[np.ndarray, "envs action"]:
        time.sleep(self.wait_ms / 1000 * len(actions))
        return super().drive(actions, rng)
