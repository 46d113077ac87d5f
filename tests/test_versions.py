"""Other versions of JAX, MuJoCo and NumPy act, learn and move bodies as those that were recorded.

`python tests/test_versions.py` records anew, for a change of ours that is meant to change numbers.
"""

import functools
import json
from importlib.metadata import version
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Float

from everystate import envs
from everystate.agent import load, named_arrays
from everystate.learning.models import Scale, Space
from everystate.learning.replay import Transitions
from everystate.presets import preset
from everystate.training.learner import begin, compiled

RECORDED = Path(__file__).with_name("versions.json")
PACKAGES = ("jax", "jaxlib", "mujoco", "numpy", "equinox", "flowjax", "optax")


def waves(*shape: int, by: float = 1.0) -> Float[np.ndarray, "..."]:
    """Numbers in [-1, 1] that no version draws otherwise."""
    return np.cos(by * np.arange(np.prod(shape)) ** 1.5).reshape(shape).astype(np.float32)


def acted(name: str) -> dict[str, Any]:
    """What a trained agent does and thinks in states on its way to goals."""
    agent = load(name)
    centre, spread = (np.array(x) for x in zip(*agent.units.values(), strict=True))
    states, goals = (centre + spread * waves(6, len(centre), by=x) for x in (1.0, 1.3))
    return {
        "actions": agent.act(states, goals),
        "values": agent.value(states, goals),
        "log_density": agent.log_density(states),
    }


@functools.cache
def learned() -> dict[str, Any]:
    """The losses of one update of fresh models, and sizes of their arrays after it."""
    config = preset("test", num_updates=1, target_period=1)
    steps, bodies = config.warmup_steps, config.num_bodies
    states = np.cumsum(0.1 * waves(steps + 1, bodies, 2), axis=0)
    goals = np.broadcast_to(states[-1], states[1:].shape)
    moves = states[:-1], waves(steps, bodies, 2), states[1:], goals
    warmup = Transitions(*map(jnp.asarray, moves))
    begun = begin(config, Space(2, 2), warmup, Scale(jnp.zeros(2), jnp.ones(2)))
    state, metrics, _ = compiled(config).update(begun)
    arrays = named_arrays(state.models)
    return {
        "losses": {name: float(x) for name, x in metrics.items() if name.startswith("loss/")},
        "models": {name: float(jnp.linalg.norm(x.ravel())) for name, x in arrays.items()},
    }


def moved(name: str) -> dict[str, Any]:
    """Where a body, which nothing disturbs, is after some steps."""
    still = {"noise_sigma": 0.0} if name == "ramp-pointmass" else {}
    env = envs.make(name, 4, 0, **still)
    states = np.asarray(env.reset(seed=0)[0])
    for actions in waves(8, 4, env.single_action_space.shape[0]):
        states = env.step(actions)[0]
    return {"states": states}


def recorded(kind: str, name: str) -> dict[str, Any]:
    return json.loads(RECORDED.read_text())[kind][name]


@pytest.mark.parametrize("name", envs.BODIES)
def test_an_agent_acts_as_recorded(name: str) -> None:
    expected, found = recorded("acted", name), acted(name)
    np.testing.assert_allclose(found["actions"], expected["actions"], rtol=0, atol=1e-5)
    for thought in ("values", "log_density"):
        np.testing.assert_allclose(found[thought], expected[thought], rtol=1e-4, err_msg=thought)


@pytest.mark.parametrize("part", ["losses", "models"])
def test_an_update_learns_as_recorded(part: str) -> None:
    assert learned()[part] == pytest.approx(recorded("learned", part), rel=1e-4, abs=1e-5)


@pytest.mark.parametrize("name", envs.BODIES)
def test_a_body_moves_as_recorded(name: str) -> None:
    np.testing.assert_allclose(moved(name)["states"], recorded("moved", name)["states"], atol=1e-5)


def main() -> None:
    """Records what this version does."""
    found: dict[str, Any] = {"versions": {name: version(name) for name in PACKAGES}}
    found["acted"] = {name: acted(name) for name in envs.BODIES}
    found["learned"] = learned()
    found["moved"] = {name: moved(name) for name in envs.BODIES}
    text = json.dumps(found, indent=1, default=lambda x: np.round(x.astype(float), 7).tolist())
    RECORDED.write_text(text + "\n")


if __name__ == "__main__":
    main()
