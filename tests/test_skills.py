"""Named skills: rules on hand-made trajectories, and agents that know them or do not."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

from everystate import cli, evaluation, goals
from everystate.agent import Performance
from everystate.config import Config
from everystate.envs import BODIES, make
from everystate.envs import ramp_pointmass as ramp_body
from everystate.envs.cartpole import Cartpole
from everystate.errors import EverystateError
from everystate.presets import preset
from everystate.skills import SKILLS, cartpole, ramp_pointmass, skill, skills_of

NAMES = [(body, name) for body, table in SKILLS.items() for name in table]


def swing(angles: np.ndarray, x: float = 0.0) -> np.ndarray:
    """States [steps, 1, 5] of a pole at these angles, with the velocity that they imply."""
    speed = np.gradient(angles) / 0.04
    zero = np.zeros_like(angles)
    return np.stack([zero + x, np.cos(angles), np.sin(angles), zero, speed], axis=1)[:, None]


def done(name: str, states: np.ndarray, body: str = "cartpole") -> bool:
    (result,) = skill(body, name).done(states)
    return bool(result)


@pytest.mark.parametrize(("body", "name"), NAMES)
def test_every_skill_asks_for_what_its_body_has(body: str, name: str) -> None:
    one = skill(body, name)
    env = make(body, 3, 0)
    env.set_observations(one.starts(np.random.default_rng(0), 3))
    for step in (0, one.steps - 1, one.steps + 100):
        goal = one.goal(step)
        if isinstance(goal, Mapping):
            goals.asked(goal, env.state_names)  # raises for what it has not
        else:
            assert len(goal) == len(env.state_names)
    assert one.whole == all(isinstance(goal, tuple) for goal in one.goals)
    assert one.goal(0) == one.goals[0]
    assert one.goal(one.steps - 1) == one.goals[-1]


@pytest.mark.parametrize(("body", "name"), NAMES)
def test_rules_can_be_asked_from_the_first_step_on(body: str, name: str) -> None:
    one = skill(body, name)
    goal = np.array(one.goals[-1]) if one.whole else one.starts(np.random.default_rng(0), 1)[0]
    for steps in (1, 2, 4):
        assert one.done(np.tile(goal, (steps, 3, 1))).shape == (3,)
        assert name in ("jump", "pass-top") or not one.done(np.tile(goal, (steps, 3, 1))).any()


def test_balance_is_ten_seconds_without_a_break() -> None:
    up, down = np.zeros(300), np.full(300, np.pi)
    assert done("balance", swing(np.concatenate([down, up])))
    assert done("balance", swing(np.concatenate([down, up, down])))
    broken = np.concatenate([down, up[:240], down[:5], up[:240]])
    assert not done("balance", swing(broken))
    assert not done("balance", swing(np.full(600, 0.4)))


def test_balance_keeps_the_cart_off_the_ends_of_the_rail() -> None:
    track = Cartpole().model.joint("cart").range
    np.testing.assert_allclose(track, (-cartpole.RAIL, cartpole.RAIL))
    up = np.zeros(300)
    for side in (-1, 1):
        assert done("balance", swing(up, side * 1.5))
        assert not done("balance", swing(up, side * 1.7))
    swung_up = swing(up)
    swung_up[:40, :, 0] = 1.8  # while the pole is not yet counted as up it may touch an end
    assert done("balance", swung_up)


def test_spins_are_counted_net_and_by_their_side() -> None:
    right = swing(np.linspace(np.pi, 12 * np.pi, 251))
    assert done("spin-right", right)
    assert not done("spin-left", right)
    assert done("spin-left", swing(np.linspace(np.pi, -12 * np.pi, 251)))
    to_and_fro = swing(10 * np.pi * np.sin(np.linspace(0, np.pi, 251)))
    assert not done("spin-right", to_and_fro)
    assert not done("spin-left", to_and_fro)


def test_hanging_is_at_a_place_and_still_at_the_end() -> None:
    still = np.full(251, np.pi)
    for name, x in (("hang-left", -1.0), ("hang-middle", 0.0), ("hang-right", 1.0)):
        assert done(name, swing(still, x + 0.1))
        assert not done(name, swing(still, x + 0.3))
    swinging = np.pi + 0.3 * np.sin(np.arange(251) * 0.3)
    assert not done("hang-middle", swing(swinging))


def test_passing_the_top_needs_the_speed() -> None:
    assert done("pass-top", swing(np.linspace(-np.pi, np.pi, 32)))  # about 5 rad/s
    assert not done("pass-top", swing(np.linspace(-np.pi, np.pi, 64)))
    assert not done("pass-top", swing(np.linspace(np.pi, -np.pi, 32)))
    beyond = np.linspace(-np.pi, -0.02, 251) + 0.32  # comes to 0.3 rad beyond it by slow steps
    kicked = swing(beyond)
    kicked[-2:, :, 4] = 5.0  # and only there is it fast
    assert not done("pass-top", kicked)


def test_spinning_and_passing_the_top_are_off_the_ends_of_the_rail() -> None:
    right, left = (swing(np.linspace(np.pi, way * 12 * np.pi, 251)) for way in (1, -1))
    passing = swing(np.linspace(-np.pi, np.pi, 32))
    for name, states in (("spin-right", right), ("spin-left", left), ("pass-top", passing)):
        assert done(name, states)
        states[3, :, 0] = -1.7
        assert not done(name, states), name


def test_ramming_the_ends_of_the_rail_is_no_skill() -> None:
    for name in ("spin-left", "spin-right", "pass-top"):
        one, env = skill("cartpole", name), make("cartpole", 100, 0)
        states = [one.starts(np.random.default_rng(0), 100).astype(np.float32)]
        env.set_observations(states[0])
        for step in range(one.steps):
            blind = np.full((100, 1), 1.0 if step // 20 % 2 == 0 else -1.0)
            states.append(env.step(blind)[0])
        rammed = np.stack(states)
        angle = np.unwrap(np.arctan2(rammed[..., 2], rammed[..., 1]), axis=0)
        assert (np.abs(angle[-1] - angle[0]) >= 10 * np.pi).any()  # five turns of the pole
        assert not one.done(rammed).any()


def test_those_who_wait_hang_nowhere() -> None:
    for name in ("hang-left", "hang-middle", "hang-right"):
        one, env = skill("cartpole", name), make("cartpole", 100, 0)
        states = [one.starts(np.random.default_rng(0), 100).astype(np.float32)]
        env.set_observations(states[0])
        for _ in range(one.steps):
            states.append(env.step(np.zeros((100, 1)))[0])
        assert not one.done(np.stack(states)).any()


def walk(*places: tuple[float, float]) -> np.ndarray:
    """States [steps, 1, 2] of a ball that rests at each place for ten steps."""
    return np.repeat(np.array(places), 10, axis=0)[:, None]


def test_the_edges_of_the_ramp_are_those_of_the_body() -> None:
    axis = np.linspace(-1, 1, 201)
    places = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    places = np.concatenate([places, [[0.0, 0.6], [0.5, 0.0], [0.7, -0.6]]])
    where = ramp_body.region(places)
    np.testing.assert_array_equal(ramp_pointmass.on_ledge(places), where == "ledge")
    np.testing.assert_array_equal(ramp_pointmass.on_floor(places), where == "floor")


FLOOR, LEDGE, RAMP = (-0.8, -0.8), (0.8, 0.8), (0.8, 0.0)


def test_climbing_ends_on_the_ledge() -> None:
    below = ramp_body.set_down(np.array([[0.0, 0.58]], np.float32))  # as near as a ball comes
    np.testing.assert_allclose(below, [[0.0, 0.55]], rtol=1e-6)
    assert np.abs(below - np.array([0.0, 0.8])).max() < 0.25  # near enough, were it up there
    assert not done("climb", walk(FLOOR, (0.0, float(below[0, 1]))), "ramp-pointmass")
    for end in ((0.0, 0.8), (0.2, 0.62)):
        assert done("climb", walk(FLOOR, RAMP, LEDGE, end), "ramp-pointmass")
    assert not done("climb", walk(LEDGE, (0.0, 0.8)), "ramp-pointmass")
    assert not done("climb", walk(FLOOR, RAMP, LEDGE), "ramp-pointmass")


def test_crossing_is_along_the_ledge() -> None:
    assert done("cross", walk(LEDGE, (0.0, 0.65), (-0.85, 0.65)), "ramp-pointmass")
    assert not done("cross", walk(LEDGE, (-0.85, 0.55)), "ramp-pointmass")
    assert not done("cross", walk(LEDGE, (0.0, 0.55), (-0.85, 0.8)), "ramp-pointmass")
    assert not done("cross", walk(RAMP, LEDGE, (-0.85, 0.8)), "ramp-pointmass")


def test_coming_back_is_from_the_ledge_to_the_floor() -> None:
    assert done("come-back", walk((-0.8, 0.8), LEDGE, RAMP, (-0.3, -0.3)), "ramp-pointmass")
    assert not done("come-back", walk((-0.8, 0.55), (-0.3, -0.3)), "ramp-pointmass")
    assert not done("come-back", walk((-0.8, 0.8), LEDGE, RAMP), "ramp-pointmass")


class Walker:
    """Knows its way on the ramp: round the foot of the ramp and up, or straight on."""

    config: Config = preset("test")

    def __init__(self, useless: bool = False) -> None:
        self.useless = useless

    def act(self, observation: Any, goal: Any, *, plan: bool = False, seed: int = 0) -> np.ndarray:
        x, y = np.asarray(observation).T
        gx, gy = np.broadcast_to(goal, np.shape(observation)).T
        up = (gy > 0.6) & (y < 0.55)
        on_ramp = x > 0.6
        tx = np.where(up, 0.8, gx)
        ty = np.where(up & ~on_ramp, -0.85, np.where(up, 0.9, gy))
        down = (gy < 0.5) & (x > 0.45)
        tx, ty = np.where(down & (y > -0.7), 0.8, tx), np.where(down, -0.85, ty)
        action = np.clip(np.stack([tx - x, ty - y], axis=1) / 0.1, -1, 1)
        return (0 * action if self.useless else action).astype(np.float32)

    def steps_to_goal(self, observation: Any, goal: Any) -> np.ndarray:
        return np.zeros(len(observation))


def test_one_who_knows_the_way_succeeds_and_an_idle_one_does_not() -> None:
    assert min(evaluation.success_rates(Walker(), plan=False).values()) >= 0.9
    assert max(evaluation.success_rates(Walker(useless=True), plan=True).values()) == 0.0


def test_successes_are_told_start_by_start() -> None:
    each = evaluation.successes(Walker(), plan=False, seed=1)
    rates = evaluation.success_rates(Walker(), plan=False, seed=1)
    assert {name: done.mean() for name, done in each.items()} == rates
    assert {done.shape for done in each.values()} == {(100,)}


def test_a_skill_that_asks_for_parts_is_for_agents_that_complete_them() -> None:
    """From fewer starts; whoever knows whole states only is not asked."""

    class Standing:
        config, asked = preset("test", "cartpole"), []

        def act(self, observation: Any, goal: Any, **_: Any) -> np.ndarray:
            self.asked.append(goal)
            return np.zeros((len(observation), 1), np.float32)

        def steps_to_goal(self, observation: Any, goal: Any) -> np.ndarray:
            return np.zeros(len(observation))

    class Completes(Standing):
        def complete(self, observation: Any, goal: Any) -> Any:
            raise AssertionError("the skill's goal goes to act as it is")

    whole = evaluation.successes(Standing(), plan=False)
    assert set(whole) == {n for n, one in SKILLS["cartpole"].items() if one.whole}
    every = evaluation.successes(Completes(), plan=False)
    assert set(every) == set(SKILLS["cartpole"])
    assert {n for n, done in every.items() if done.shape == (20,)} == set(every) - set(whole)
    assert {"pole_angle": 0.0, "pole_velocity": 0.0} in [
        goal for goal in Completes.asked if isinstance(goal, dict)
    ]


def test_a_fall_spoils_a_skill_that_forbids_it() -> None:
    class Jumper(Walker):
        def act(self, *args: Any, **kwargs: Any) -> np.ndarray:
            action = np.zeros((100, 2), dtype=np.float32)
            action[:, 1] = -1.0
            return action

    states, ok = evaluation.perform(Jumper(), skill("ramp-pointmass", "cross"), plan=False)
    assert states.shape == (61, 100, 2)
    assert not ok.any()


def test_a_performance_goes_from_goal_to_goal() -> None:
    performance = Performance(Walker(), skill("ramp-pointmass", "come-back"), False, 0)
    goals = []
    while not performance.over:
        goals.append(tuple(round(float(x), 2) for x in np.array(performance.goal)))
        performance(np.zeros((4, 2), dtype=np.float32))
    assert list(dict.fromkeys(goals)) == [(0.75, 0.8), (0.75, -0.8), (-0.3, -0.3)]
    assert len(goals) == 150


def test_what_is_not_there_is_named() -> None:
    with pytest.raises(EverystateError, match="no skill 'balence': did you mean 'balance'"):
        skill("cartpole", "balence")
    with pytest.raises(EverystateError, match="arm has no named skills; these have: cartpole"):
        skills_of("arm")
    assert set(SKILLS) <= set(BODIES)

    class Walks(Walker):
        config = preset("test", "experiments/arm.xml")

        def act(self, *args: Any, **kwargs: Any) -> np.ndarray:
            raise AssertionError("measured before the skills were looked for")

    with pytest.raises(EverystateError, match=r"arm\.xml has no named skills"):
        evaluation.evaluate(Walks(), skills=True)


def test_skills_are_listed(capsys: pytest.CaptureFixture) -> None:
    assert cli.main(["skills", "cartpole"]) == 0
    shown = capsys.readouterr().out
    assert "balance: swing up from hanging" in shown
    assert "climb" not in shown
    assert cli.main(["skills", "arm"]) == 2
