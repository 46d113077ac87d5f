"""On level ground what is learned facing one way holds facing any."""

from itertools import product
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import everystate
from everystate import envs, portable
from everystate.errors import EverystateError
from everystate.learning.facing import about_zero, alike, inward, outward
from everystate.learning.flows import decode
from everystate.learning.models import Models, Space, new_models
from everystate.presets import preset

HORIZONTAL = ((1, 2), (4, 5))
SIZE, ANGLE = 6, 2.0
MOVER = """<mujoco><worldbody>{fixed}
  <geom name="ground" type="plane" size="9 9 1"{ground}/>
  <body name="trunk" pos="0 0 .3"><freejoint name="trunk"/><geom type="box" size=".2 .1 .05"/>
    <site name="back" pos="-.2 0 0"/>
    <body pos=".2 0 0"><joint name="leg" axis="0 1 0" range="-60 60"/>
      <geom type="capsule" fromto="0 0 0 .1 .1 -.3" size=".03"/></body></body>
  {others}</worldbody>
  <actuator><motor joint="leg" gear="3"/>{motors}</actuator>{rest}</mujoco>"""


def mover(tmp_path: Path, **parts: str) -> str:
    names = ("fixed", "ground", "others", "motors", "rest")
    path = tmp_path / "mover.xml"
    path.write_text(MOVER.format(**{name: parts.get(name, "") for name in names}))
    return str(path)


def turned(states: Any, horizontal: Any, angle: float = ANGLE) -> np.ndarray:
    """States of bodies turned to the left, by components that turn with them."""
    states = np.asarray(states)
    result, (x, y) = states.copy(), np.array(horizontal).T
    result[..., x] = np.cos(angle) * states[..., x] - np.sin(angle) * states[..., y]
    result[..., y] = np.sin(angle) * states[..., x] + np.cos(angle) * states[..., y]
    return result


@pytest.mark.parametrize(("body", "angle"), [("ant", np.pi / 2), ("mover", ANGLE)])
def test_a_body_on_level_ground_does_the_same_turned(
    body: str, angle: float, tmp_path: Path
) -> None:
    # MuJoCo's pyramids of friction have corners, at quarter turns, where its cones have none.
    body = body if body == "ant" else mover(tmp_path, rest='<option cone="elliptic"/>')
    env, turning = (envs.make(body, 20, 0) for _ in range(2))
    rng = np.random.default_rng(0)

    def actions() -> np.ndarray:
        return rng.uniform(-1, 1, env.action_space.shape).astype(np.float32)

    states = env.step(actions())[0]
    for _ in range(19):
        states = env.step(actions())[0]
    assert len(env.horizontal) == 3
    assert np.abs(states - env.reset(seed=1)[0])[:, :6].max() > 0.1
    env.set_observations(states)
    turning.set_observations(turned(states, env.horizontal, angle))
    after, after_turned = (e.step(a)[0] for a in [actions()] for e in (env, turning))
    np.testing.assert_allclose(turned(after, env.horizontal, angle), after_turned, atol=2e-3)
    assert np.abs(after - after_turned).max() > 0.5


@pytest.mark.parametrize(
    "parts",
    [
        {"fixed": '<geom type="box" pos="2 0 0" size=".1 1 1"/>'},
        {"ground": ' euler="10 0 0"'},
        {"others": '<body pos="1 0 1"><freejoint/><geom size=".1"/></body>'},
        {"others": '<body pos="1 0 1"><joint type="slide"/><geom size=".1"/></body>'},
        {"others": '<body mocap="true" pos="1 0 1"><geom size=".1"/></body>'},
        {"motors": '<motor joint="trunk" gear="1 0 0 0 0 0"/>'},
        {"rest": '<option gravity="1 0 -9.81"/>'},
        {"rest": '<option wind="1 0 0"/>'},
        {"rest": '<equality><connect body1="trunk" anchor="0 0 0"/></equality>'},
        {
            "fixed": '<site name="hook" pos="0 0 2"/>',
            "rest": "<tendon><spatial><site site='hook'/><site site='back'/></spatial></tendon>",
        },
        {
            "fixed": '<site name="hook" pos="0 0 2"/>',
            "motors": '<general site="back" refsite="hook" gear="1 0 0 0 0 0"/>',
        },
    ],
)
def test_what_tells_directions_apart_is_noticed(parts: dict[str, str], tmp_path: Path) -> None:
    body = mover(tmp_path, **parts)
    assert envs.make(body, 1, 0).horizontal == ()


def test_places_and_sensors_and_states_without_heading_do_not_turn(tmp_path: Path) -> None:
    sensors = '<sensor><velocimeter site="back"/></sensor>'
    body = mover(tmp_path, rest=sensors)
    assert envs.make(body, 1, 0).horizontal == ((1, 2), (4, 5), (8, 9))
    for option in ({"travel": True}, {"sensors": True}, {"heading": False}):
        assert envs.make(body, 1, 0, **option).horizontal == ()


def test_a_body_that_is_driven_or_seen_in_a_way_of_its_own_does_not_turn() -> None:
    class Driven(envs.Ant):
        def drive(self, actions: Any, rng: np.random.Generator) -> Any:
            return -actions

    assert envs.Ant().horizontal
    assert Driven().horizontal == ()


def known(name: str = "quick") -> Models:
    """Models of such a body that learned nothing, but differ at every state."""
    config, rng = preset(name, "any-body.xml", width=16, depth=1), np.random.default_rng(0)
    space, scale = Space(SIZE, 2, HORIZONTAL), jnp.linspace(0.2, 0.4, SIZE)
    models = new_models(config, space, scale, key=jax.random.key(0))

    def stirred(x: Any) -> Any:
        if not eqx.is_inexact_array(x) or (jnp.abs(x) == 1).all():
            return x  # Signs and weights are no parameters.
        return x + 0.2 * rng.normal(size=x.shape).astype(np.float32)

    stir = jax.tree.map(stirred, models)
    return eqx.tree_at(lambda m: m.dynamics.change_scale, stir, models.dynamics.change_scale)


def pair() -> tuple[jax.Array, ...]:
    rng = np.random.default_rng(1)
    return tuple(jnp.asarray(rng.normal(size=n), jnp.float32) for n in (SIZE, SIZE, 2, SIZE))


def test_models_see_no_more_than_where_the_goal_is_from_where_the_body_faces() -> None:
    models, (s, g, a, z) = known(), pair()
    s2, g2 = (jnp.asarray(turned(x, HORIZONTAL)) for x in (s, g))
    for V, policy in product(models.values, models.policies):
        assert float(V(s, g)) == pytest.approx(float(V(s2, g2)), abs=1e-4)
        assert abs(float(V(s, g) - V(s2, g))) > 1e-3
        for one, other in (
            (policy.central(s, g), policy.central(s2, g2)),
            (policy.at(s, g, a), policy.at(s2, g2, a)),
        ):
            np.testing.assert_allclose(one, other, atol=1e-4)
    d = models.dynamics
    np.testing.assert_allclose(turned(d.central(s, a), HORIZONTAL), d.central(s2, a), atol=1e-4)
    after, after2 = (decode(d(x, a), z) for x in (s, s2))
    np.testing.assert_allclose(turned(after, HORIZONTAL), after2, atol=1e-4)
    density, density2 = d(s, a).log_prob(after), d(s2, a).log_prob(after2)
    assert float(density) == pytest.approx(float(density2), rel=1e-3)


def test_a_density_that_is_turned_is_one() -> None:
    d, (s, _, a, z) = known().dynamics, pair()
    flow = d(s, a)
    jacobian = jax.jacobian(lambda z: decode(flow, z))(z)
    volume = jnp.linalg.slogdet(jacobian)[1]
    standard = jax.scipy.stats.norm.logpdf(z).sum()
    density = flow.log_prob(decode(flow, z))
    assert float(density) == pytest.approx(float(standard - volume), rel=1e-3)


def test_the_papers_models_see_everything() -> None:
    models, (s, g, _, _) = known("paper"), pair()
    s2, g2 = (jnp.asarray(turned(x, HORIZONTAL)) for x in (s, g))
    (V,) = models.values
    assert abs(float(V(s, g) - V(s2, g2))) > 1e-3


@pytest.mark.parametrize("length", [0.0, 0.05, 0.5])
def test_turning_back_is_the_inverse_and_its_slope_is_finite(length: float) -> None:
    s, g, *_ = pair()
    s = s.at[jnp.array(HORIZONTAL[0])].set(jnp.array([0.6, 0.8]) * length)
    np.testing.assert_allclose(outward(HORIZONTAL, s, inward(HORIZONTAL, s, g)), g, atol=1e-6)
    ahead = inward(HORIZONTAL, s, s)[jnp.array(HORIZONTAL[0])]
    if length > 0.1:
        np.testing.assert_allclose(ahead, [length, 0.0], atol=1e-6)
    slope = jax.jacobian(lambda s: inward(HORIZONTAL, s, g))(s)
    assert np.isfinite(slope).all()


def test_units_are_the_same_from_all_sides() -> None:
    units = alike(HORIZONTAL, jnp.array([1.0, 3.0, 4.0, 5.0, 6.0, 8.0]))
    both = [np.sqrt(12.5), np.sqrt(50.0)]
    np.testing.assert_allclose(units, [1, both[0], both[0], 5, both[1], both[1]], rtol=1e-6)
    np.testing.assert_array_equal(about_zero(HORIZONTAL, jnp.ones(6)), [1, 0, 0, 1, 0, 0])
    np.testing.assert_array_equal(about_zero((), jnp.ones(6)), np.ones(6))


def test_units_of_the_body_are_refused() -> None:
    with pytest.raises(EverystateError, match="set units to 'running', or any_heading to false"):
        preset("quick", any_heading=True, units="fixed")


def test_a_run_learns_so_and_its_agent_is_read_and_exported(tmp_path: Path) -> None:
    body = mover(tmp_path)
    run = everystate.train(body, preset="test", epochs=2, run_dir=tmp_path / "run", progress=False)
    agent = everystate.load(run)
    assert agent.body.horizontal == ((1, 2), (4, 5), (8, 9))
    for x, y in agent.body.horizontal:
        centre, spread = (np.asarray(v) for v in agent.scale)
        assert (centre[[x, y]] == 0).all()
        assert spread[x] == pytest.approx(spread[y], rel=1e-6)
        change, weights = agent.models.dynamics.change_scale, agent.models.dynamics.weights
        assert float(change[x]) == pytest.approx(float(change[y]), rel=1e-6)
        assert float(weights[x]) == pytest.approx(float(weights[y]), rel=1e-6)
    env, rng = envs.make(body, 20, 0), np.random.default_rng(0)
    states = env.step(rng.uniform(-1, 1, env.action_space.shape).astype(np.float32))[0]
    goals = states[::-1]
    expected = agent.act(states, goals)
    turn = [turned(x, env.horizontal).astype(np.float32) for x in (states, goals)]
    np.testing.assert_allclose(agent.act(*turn), expected, atol=1e-4)
    asked = agent.complete(states, {"height": 0.3})
    np.testing.assert_allclose(asked[:, 0], 0.3, atol=1e-5)
    angles = [np.arctan2(x[:, 2], x[:, 1]) for x in (asked, states)]
    np.testing.assert_allclose(np.cos(angles[0] - angles[1]), 1, atol=1e-4)
    policy = portable.load(agent.export(tmp_path / "policy.npz"))
    np.testing.assert_allclose(policy.act(states, goals), expected, atol=1e-5)
    np.testing.assert_allclose(policy.act(*turn), expected, atol=1e-4)
