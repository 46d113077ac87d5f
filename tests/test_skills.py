"""Named skills: rules on hand-made trajectories, and agents that know them or do not."""

from typing import Any

import numpy as np
import pytest

from everystate import cli, evaluation, load
from everystate.agent import Performance
from everystate.config import Config
from everystate.envs import BODIES, make
from everystate.errors import EverystateError
from everystate.presets import preset
from everystate.skills import SKILLS, skill, skills_of

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
        assert len(one.goal(step)) == len(env.state_names)
    assert one.goal(0) == one.goals[0]
    assert one.goal(one.steps - 1) == one.goals[-1]


def test_balance_is_ten_seconds_without_a_break() -> None:
    up, down = np.zeros(300), np.full(300, np.pi)
    assert done("balance", swing(np.concatenate([down, up])))
    assert done("balance", swing(np.concatenate([down, up, down])))
    broken = np.concatenate([down, up[:240], down[:5], up[:240]])
    assert not done("balance", swing(broken))
    assert not done("balance", swing(np.full(600, 0.4)))


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


def test_a_fall_spoils_a_skill_that_forbids_it() -> None:
    class Jumper(Walker):
        def act(self, *args: Any, **kwargs: Any) -> np.ndarray:
            action = np.zeros((20, 2), dtype=np.float32)
            action[:, 1] = -1.0
            return action

    states, ok = evaluation.perform(Jumper(), skill("ramp-pointmass", "cross"), plan=False)
    assert states.shape == (61, 20, 2)
    assert not ok.any()


def test_a_performance_goes_from_goal_to_goal() -> None:
    performance = Performance(Walker(), skill("ramp-pointmass", "come-back"), False, 0)
    goals = []
    while not performance.over:
        goals.append(tuple(round(float(x), 2) for x in performance.goal))
        performance(np.zeros((4, 2), dtype=np.float32))
    assert list(dict.fromkeys(goals)) == [(0.75, 0.8), (0.75, -0.8), (-0.3, -0.3)]
    assert len(goals) == 150


@pytest.mark.slow
def test_the_cartpole_that_comes_along_balances_and_spins_both_ways() -> None:
    agent = load("cartpole")
    for name in ("balance", "spin-left", "spin-right"):
        _, ok = evaluation.perform(agent, skill("cartpole", name), plan=True, seed=3, starts=5)
        assert ok.all(), name


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
