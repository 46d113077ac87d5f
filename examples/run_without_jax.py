"""The cartpole swings up by an exported agent, with NumPy and MuJoCo alone.

First `everystate export cartpole policy.npz`, then `python examples/run_without_jax.py policy.npz`.
"""

import sys
from pathlib import Path

import mujoco
import numpy as np

from everystate import portable

policy = portable.load(sys.argv[1])
model = mujoco.MjModel.from_xml_path(str(Path(portable.__file__).parent / "envs/cartpole.xml"))
data = mujoco.MjData(model)
low, high = model.actuator_ctrlrange.T  # what the motor takes for -1 and for 1


def state() -> np.ndarray:
    """Place of the cart, cosine and sine of the pole's angle, both velocities."""
    x, angle = data.qpos
    return np.array([x, np.cos(angle), np.sin(angle), *data.qvel])


data.qpos[1] = np.pi  # hanging
upright = [0.0, 1.0, 0.0, 0.0, 0.0]
for _ in range(250):  # ten seconds
    data.ctrl[:] = low + (policy.act(state(), upright) + 1) / 2 * (high - low)
    mujoco.mj_step(model, data, nstep=4)  # physics steps per control step, as in training

x, cosine, sine, *_ = state()
print(f"angle from upright: {np.degrees(np.arctan2(abs(sine), cosine)):.1f} degrees")
print(f"cart from the middle: {100 * abs(x):.1f} cm")
