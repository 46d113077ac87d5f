"""The cartpoles of experiments/invariance.py are the cartpole, observed in other ways."""

import altered
import numpy as np
import pytest

from everystate import envs

KINDS = ["Altered", "Rescaled", "Shifted", "Repeated", "Constant", "OfCopy", "Noise"]
COPIES = 3


def played(body: str) -> np.ndarray:
    env, rng = envs.make(body, COPIES, 0), np.random.default_rng(0)
    states = [env.reset(seed=0)[0]]
    states += [env.step(rng.uniform(-1, 1, (COPIES, 1)))[0] for _ in range(20)]
    return np.stack(states)


@pytest.mark.parametrize("kind", KINDS)
def test_it_moves_like_the_cartpole(kind) -> None:
    states, own = played(f"altered:{kind}"), played("cartpole")
    body: altered.Altered = getattr(altered, kind)()
    np.testing.assert_allclose(body.plain(states), own, atol=2e-4)
    np.testing.assert_allclose(body.altered(own[-1])[:, :5], states[-1][:, :5], rtol=1e-3)
    assert (kind == "Altered") == (np.shape(states) == np.shape(own) and np.allclose(states, own))
    assert len(body.state_names) == states.shape[-1]


def test_what_is_added_is_what_it_says() -> None:
    added = {kind: played(f"altered:{kind}")[..., 5:] for kind in KINDS}
    sine = played("altered:Repeated")[..., [2]]
    assert (added["Repeated"] == sine).all()
    assert np.ptp(added["Constant"]) == 0
    assert (np.ptp(added["OfCopy"], axis=0) == 0).all()
    assert len(np.unique(added["OfCopy"])) == COPIES
    assert 0.6 < (added["Noise"] == 0).mean() < 0.95
