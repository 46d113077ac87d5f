"""Heading, pitch, pole angle and the like: read off states, and set in them."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from everystate import envs
from everystate.features import Part, features, parts

ANT = tuple(envs.make("ant", 1, 0).state_names)
LEVEL = tuple(
    n for n in [*ANT[:1], *(f"torso_up{a}" for a in "xyz"), *ANT[15:21], "knee", "knee_velocity"]
)
NEW = {
    "height": 0.4,
    "heading": -100.0,
    "pitch": 30.0,
    "roll": 120.0,
    "forward_velocity": 0.5,
    "sideways_velocity": -0.3,
    "turning_rate": 1.2,
}


def ants(n: int = 20) -> tuple[Float[np.ndarray, "n 29"], Rotation]:
    """In any orientation, with any velocities."""
    rng = np.random.default_rng(0)
    states, turned = rng.normal(size=(n, 29)), Rotation.random(n, rng=rng)
    states[:, 1:7] = np.concatenate([turned.as_matrix()[:, :, i] for i in range(2)], axis=1)
    return states, turned


def levelled() -> Float[np.ndarray, "n 12"]:
    """The same without their heading: up and velocities in their own frames."""
    states, turned = ants()
    up = turned.inv().apply([0, 0, 1])
    own = turned.inv().apply(states[:, 15:18])
    legs = np.ones((len(states), 2))
    return np.concatenate([states[:, :1], up, own, states[:, 18:21], legs], axis=1)


def of(names: tuple[str, ...]) -> Part:
    (part,) = parts(names)
    return part


def test_an_ant_that_leans_and_goes_is_told_as_one_would_say():
    state = np.zeros(29)
    facing = Rotation.from_euler("ZYX", [90, -20, 10], degrees=True)  # left, nose up, left side up
    state[1:7] = facing.as_matrix()[:, :2].T.ravel()
    state[15:18] = 0.3, 2.0, 1.0  # world: it faces along y, so x is to its right
    state[18:21] = facing.inv().apply([0, 0, 1.5])
    found = of(ANT).read(state)
    expected = {
        "height": 0,
        "heading": 90,
        "pitch": 20,
        "roll": 10,
        "forward_velocity": 2.0,
        "sideways_velocity": -0.3,
        "turning_rate": 1.5,
    }
    assert found == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize(("names", "states"), [(ANT, ants()[0]), (LEVEL, levelled())])
@pytest.mark.parametrize("name", NEW)
def test_a_feature_that_is_set_is_read_so_and_the_others_stay(names, states, name):
    part = of(names)
    if name not in features(names):
        assert (name, names) == ("heading", LEVEL)
        return
    before, after = part.read(states), part.set(states, {name: np.full(len(states), NEW[name])})
    now = part.read(after)
    np.testing.assert_allclose(now[name], NEW[name], atol=1e-6)
    leans = name in ("pitch", "roll") and {"turning_rate"}  # about another axis of its own
    for other in before.keys() - {name} - set(leans or ()):
        np.testing.assert_allclose(now[other], before[other], atol=1e-6, err_msg=other)
    changed = {n for n, x in zip(names, (after != states).T, strict=True) if x.any()}
    legs = [n for n in names if not n.startswith("torso")]
    assert not changed & set(legs)


@pytest.mark.parametrize(("names", "states"), [(ANT, ants()[0]), (LEVEL, levelled())])
def test_all_at_once_and_by_jax(names, states):
    part = of(names)
    new = {n: np.full(len(states), x) for n, x in NEW.items() if n in features(names)}
    after = part.set(states, new)
    for name, value in part.read(after).items():
        np.testing.assert_allclose(value, NEW[name], atol=1e-6)
    jitted = jax.jit(lambda s: part.set(s, {n: jnp.asarray(x) for n, x in new.items()}))
    np.testing.assert_allclose(jitted(jnp.asarray(states)), after, atol=1e-5)


def test_an_orientation_that_is_set_is_one():
    after = of(ANT).set(ants()[0], {"pitch": np.full(20, 40.0), "roll": np.full(20, -70.0)})
    x, y = after[:, 1:4], after[:, 4:7]
    np.testing.assert_allclose([(x * x).sum(1), (y * y).sum(1)], 1, atol=1e-9)
    np.testing.assert_allclose((x * y).sum(1), 0, atol=1e-9)


def test_with_and_without_the_way_it_faces_one_reads_the_same():
    whole, level = of(ANT).read(ants()[0]), of(LEVEL).read(levelled())
    for name, values in level.items():
        np.testing.assert_allclose(values, whole[name], atol=1e-6, err_msg=name)


def test_the_angle_of_a_joint_that_turns_right_round():
    part = of(("cart", "cos_pole", "sin_pole"))
    states = np.array([[0.5, 0.0, 1.0]])
    assert part.read(states)["pole_angle"] == pytest.approx(90)
    after = part.set(states, {"pole_angle": np.array([-30.0])})
    assert after[0] == pytest.approx([0.5, np.cos(np.pi / 6), -0.5])
    assert (
        features(("cart", "cos_pole", "sin_pole"))["pole_angle"].difference(
            np.array(170.0), np.array(-170.0)
        )
        == -20
    )


def test_two_free_bodies_go_by_their_names_and_a_name_that_is_taken_stays_that_of_the_state():
    two = tuple(n.replace("torso", name) for name in ("one", "two") for n in ANT[:7] + ANT[15:21])
    assert {"one_heading", "two_heading"} <= features(two).keys()
    assert "heading" not in features(two)
    assert not features((*ANT, "height"))
    assert not features(("x", "y", "cos_a", "b", "sin_a"))
