"""Other people's environments: what is taken, what is refused, ends, states, disturbances."""

import functools
import sys
import types
from collections.abc import Iterator
from typing import Any, ClassVar

import gymnasium
import numpy as np
import pytest
from gymnasium import spaces

from everystate.envs import (
    BodyVectorEnv,
    Cartpole,
    GymnasiumVectorEnv,
    MujocoVectorEnv,
    body_of,
    make,
    parse_options,
)
from everystate.errors import EverystateError

STATE = spaces.Box(-np.inf, np.inf, (2,), dtype=np.float64)
PUSH = spaces.Box(-1.0, 1.0, (1,), dtype=np.float64)


UNEVEN = spaces.Box(np.array([-1, 0], dtype=np.float32), np.array([1, 10], dtype=np.float32))


class Counter(gymnasium.Env):
    """Counts its steps and adds up its actions; ends where it is told to."""

    def __init__(
        self,
        observes: spaces.Space = STATE,
        acts: spaces.Space = PUSH,
        ends_at: int | None = None,
        grows_at: int | None = None,
        nan_at: int | None = None,
        render_mode: str | None = None,
    ) -> None:
        self.observation_space, self.action_space = observes, acts
        self.ends_at, self.grows_at, self.nan_at = ends_at, grows_at, nan_at
        self.render_mode = render_mode
        self.count, self.total = 0, 0.0

    def seen(self) -> Any:
        if isinstance(self.observation_space, spaces.Dict):
            parts = self.observation_space.items()
            return {key: np.zeros(space.shape or ()) for key, space in parts}
        state = [float(self.count), np.nan if self.count == self.nan_at else self.total]
        return np.array(state + [0.0] * (self.count == self.grows_at))

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[Any, dict]:
        super().reset(seed=seed)
        self.count, self.total = 0, float(self.np_random.uniform(100, 200))
        return self.seen(), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict]:
        self.count += 1
        self.total += float(np.sum(action))
        return self.seen(), 1.0, self.count == self.ends_at, False, {}


class Opaque(Counter):
    """Keeps part of its state where nobody can read it."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        hidden = iter(np.random.default_rng().uniform(size=10_000))
        self.draw = lambda: next(hidden)

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict]:
        self.total += float(self.draw())
        return super().step(action)


class Bare(Counter):
    """Its constructor takes nothing, as that of many a first environment."""

    metadata: ClassVar[dict[str, Any]] = {"render_modes": ["rgb_array"]}

    def __init__(self) -> None:
        super().__init__()


@pytest.fixture(autouse=True)
def _module() -> Iterator[None]:
    """A user's own module, which registers its environments when it is imported."""
    module = types.ModuleType("my_bodies")
    sys.modules["my_bodies"] = module
    for kind in (Counter, Opaque, Bare):
        # A class is what Gymnasium's own documentation registers.
        entry: Any = kind
        gymnasium.register(f"My{kind.__name__}-v0", entry, max_episode_steps=5)
    yield
    del sys.modules["my_bodies"]
    for kind in (Counter, Opaque, Bare):
        del gymnasium.registry[f"My{kind.__name__}-v0"]


def counters(num: int = 2, **options: Any) -> BodyVectorEnv:
    return make("my_bodies:MyCounter-v0", num, 0, **options)


def still(env: BodyVectorEnv, steps: int) -> list[tuple]:
    return [env.step(np.zeros(env.action_space.shape)) for _ in range(steps)]


def test_a_users_module_is_found_and_its_time_limit_removed() -> None:
    env = counters()
    counts = [result[0][:, 0].tolist() for result in still(env, 12)]
    assert counts == [[step, step] for step in range(1, 13)]


def limited(ends_at: int | None = None) -> gymnasium.Env:
    """What a user's own function makes."""
    inner = gymnasium.wrappers.TimeLimit(Counter(ends_at=ends_at), 2)
    return gymnasium.wrappers.OrderEnforcing(inner)


@pytest.mark.parametrize("factory", [limited, Counter])
def test_a_function_or_class_that_makes_environments_is_a_body(factory: Any) -> None:
    body = body_of(factory)
    assert body == f"test_adapt:{factory.__name__}"
    counts = [result[0][:, 0].tolist() for result in still(make(body, 2, 0), 5)]
    assert counts == [[step, step] for step in range(1, 6)]  # its time limit is taken off
    assert still(make(body, 1, 0, ends_at=3), 3)[-1][2].all()
    with pytest.raises(EverystateError, match="does not take these options"):
        make(body, 1, 0, wings=2)


def test_what_cannot_be_found_again_is_no_body(monkeypatch: pytest.MonkeyPatch) -> None:
    def local() -> gymnasium.Env:
        return Counter()

    for factory in (local, lambda: Counter(), functools.partial(limited, 3), Counter().reset):
        with pytest.raises(EverystateError, match=r"cannot be found again.*a module of its own"):
            body_of(factory)
    monkeypatch.setattr(limited, "__module__", "__main__")
    with pytest.raises(EverystateError, match="'limited' cannot be found again"):
        body_of(limited)
    with pytest.raises(EverystateError, match=r"test_adapt:counters makes a \w+: expected one"):
        make("test_adapt:counters", 1, 0)
    assert body_of(Cartpole) == "cartpole"


def test_a_constructor_without_arguments_will_do() -> None:
    env = make("my_bodies:MyBare-v0", 2, 0)
    assert [result[0][:, 0].tolist() for result in still(env, 2)] == [[1, 1], [2, 2]]
    assert env.exact_restore
    with pytest.raises(EverystateError, match="does not take these options"):
        make("my_bodies:MyBare-v0", 1, 0, render_mode="rgb_array")


def test_at_its_end_a_body_starts_anew_and_both_states_are_told() -> None:
    """What follows an end is another start: the step before it leads to the last state."""
    env = counters(ends_at=3)
    before, after = still(env, 3)[1:]
    assert not before[4]
    observations, _, terminated, truncated, info = after
    assert terminated.all()
    assert not truncated.any()
    assert info["_final_obs"].all()
    np.testing.assert_array_equal(info["final_obs"][:, 0], [3, 3])
    np.testing.assert_array_equal(observations[:, 0], [0, 0])
    assert (observations[:, 1] != info["final_obs"][:, 1]).all()
    assert [result[0][0, 0] for result in still(counters(ends_at=3, ends="ignore"), 5)] == [
        *range(1, 6)
    ]


def test_muscles_go_on_after_their_end() -> None:
    """Gymnasium's ant ends when it jumps; a MuJoCo body has no reason to stop there."""
    env = make("gymnasium:Ant-v5", 4, 0)
    rng = np.random.default_rng(0)
    assert isinstance(env, GymnasiumVectorEnv)
    ended = False
    for _ in range(300):
        for one in env.envs:
            z = one.unwrapped.data.qpos[2]  # pyright: ignore[reportAttributeAccessIssue]
            ended |= not 0.2 <= z <= 1.0
        assert not env.step(rng.uniform(-1, 1, env.action_space.shape))[2].any()
    assert ended


@pytest.mark.parametrize(
    ("acts", "actions", "sums"),
    [
        (spaces.Box(-2.0, 6.0, (1,)), [[-1.0], [0.5]], [-2.0, 4.0]),
        (
            spaces.Box(np.array([-1, 0], dtype=np.float32), np.array([1, 10], dtype=np.float32)),
            [[1, -1], [0, 1]],
            [1.0, 10.0],
        ),
        (spaces.Box(-1.0, 1.0, (2, 2)), [[1, 1, 1, 1], [1, 1, -1, 0]], [4.0, 1.0]),
    ],
)
def test_actions_are_scaled_to_the_bounds(
    acts: spaces.Box, actions: list, sums: list[float]
) -> None:
    env = counters(acts=acts)
    before = env.reset(seed=0)[0][:, 1]
    np.testing.assert_allclose(
        env.step(np.array(actions, dtype=np.float32))[0][:, 1] - before, sums, atol=1e-4
    )


GOALS: dict[str, spaces.Space] = {"observation": STATE, "achieved_goal": PUSH, "desired_goal": PUSH}


@pytest.mark.parametrize(
    ("observes", "names"),
    [
        (spaces.Dict(GOALS), ("observation_0", "observation_1")),
        (
            spaces.Dict({"b": PUSH, "a": spaces.Box(0.0, 1.0, (2, 1))}),
            ("a_0", "a_1", "b_0"),
        ),
    ],
)
def test_dict_observations_are_flattened_in_their_order(
    observes: spaces.Dict, names: tuple[str, ...]
) -> None:
    assert counters(observes=observes).state_names == names


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"acts": spaces.Discrete(3)}, "has Discrete actions: only Box actions"),
        ({"acts": spaces.Box(-np.inf, np.inf, (1,))}, r"ranges over \[-inf, inf\]: wrap it in gym"),
        ({"acts": spaces.Box(0.0, 0.0, (1,))}, "can only be 0: leave it out"),
        ({"observes": spaces.Discrete(3)}, "has Discrete in its observation"),
        ({"observes": spaces.Dict({"a": spaces.Discrete(3)})}, "Discrete in its observation 'a'"),
        ({"observes": spaces.Box(0, 255, (8, 8, 3), dtype=np.uint8)}, r"images \(8, 8, 3\)"),
        ({"wings": 2}, "does not take these options: .*wings"),
        ({"mass": 2.0}, "is no MuJoCo model"),
        ({"ends": "never"}, "ends is 'never'"),
        ({"action_noise": -1.0}, "action_noise is -1.0"),
    ],
)
def test_what_cannot_be_learned_is_refused_with_the_reason(
    options: dict[str, Any], said: str
) -> None:
    with pytest.raises(EverystateError, match=said):
        counters(**options)


@pytest.mark.parametrize(
    ("body", "said"),
    [
        ("gymnasium:Nowhere-v0", "`Nowhere` doesn't exist"),
        ("nowhere:Ant-v5", "no module 'nowhere'"),
        ("gymnasium:Ant-v99", "version `v99`"),
    ],
)
def test_what_is_not_there_is_named(body: str, said: str) -> None:
    with pytest.raises(EverystateError, match=said):
        make(body, 1, 0)


def test_a_missing_package_is_named_with_its_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "shimmy", None)
    with pytest.raises(EverystateError, match=r"needs shimmy: pip install 'everystate\[bodies\]'"):
        make("shimmy:dm_control/cartpole-balance-v0", 1, 0)


def test_observations_that_change_are_caught() -> None:
    with pytest.raises(EverystateError, match="has 3 numbers, where its space says 2"):
        still(counters(grows_at=3), 3)
    with pytest.raises(EverystateError, match="environment 0 is nan in observation_1"):
        still(counters(nan_at=3), 3)


def test_a_state_that_cannot_be_read_is_owned_up_to() -> None:
    assert counters().exact_restore
    assert not make("my_bodies:MyOpaque-v0", 1, 0).exact_restore


def test_bodies_that_cannot_be_placed_say_so() -> None:
    env = counters()
    assert not env.placeable
    with pytest.raises(EverystateError, match="cannot be put into a state"):
        env.set_observations(np.zeros((2, 2)))
    with pytest.raises(EverystateError, match="cannot be drawn"):
        env.render_states(np.zeros((2, 2)))


# --- Disturbances ---


def test_noise_of_actions_and_sensors_has_its_size() -> None:
    env = make("gymnasium:Pendulum-v1", 500, 0, sensor_noise=0.1)
    noisy, clean = env.reset(seed=3)[0], make("gymnasium:Pendulum-v1", 500, 0).reset(seed=3)[0]
    deviation = (noisy - clean) / env.scaling.spread
    assert deviation.std(axis=0) == pytest.approx([0.1] * 3, rel=0.15)
    sums = counters(500, action_noise=0.2)
    before = sums.reset(seed=0)[0][:, 1]
    added = sums.step(np.full((500, 1), 0.1))[0][:, 1] - before
    assert added.mean() == pytest.approx(0.1, abs=0.03)
    assert added.std() == pytest.approx(0.2, rel=0.15)
    assert np.ptp(sums.step(np.ones((500, 1)))[0][:, 1]) > 0  # clipped to the bounds


def test_actions_are_repeated_up_to_the_end() -> None:
    env = counters(action_repeat=4, ends_at=10)
    results = still(env, 3)
    assert [result[0][0, 0] for result in results] == [4, 8, 0]
    assert make("cartpole", 1, 0, action_repeat=4).control_step == pytest.approx(0.16)
    assert results[2][4]["final_obs"][0, 0] == 10


@pytest.mark.parametrize("body", ["cartpole", "gymnasium:InvertedPendulum-v5"])
def test_heavier_bodies_are_slower_and_stronger_ones_faster(body: str) -> None:
    def speed(**options: float) -> float:
        env = make(body, 1, 0, **options)
        return float(np.abs(env.step(np.ones((1, 1)))[0] - env.reset(seed=0)[0]).sum())

    assert speed(mass=3.0) < speed() < speed(force=3.0)


def test_friction_is_changed_everywhere() -> None:
    slippery = make("ant", 1, 0, friction=0.1)
    assert isinstance(slippery, MujocoVectorEnv)
    np.testing.assert_allclose(slippery.model.geom_friction[0], [0.1, 0.05, 0.05])


def test_options_on_the_command_line_are_read() -> None:
    options = ["travel=true", "mass=1.5", "frame_skip=4", "xml_file=my ant.xml"]
    assert parse_options(options) == {
        "travel": True,
        "mass": 1.5,
        "frame_skip": 4,
        "xml_file": "my ant.xml",
    }
    for wrong in ("travel", "=3", "a b=1"):
        with pytest.raises(EverystateError, match="give name=value"):
            parse_options([wrong])
