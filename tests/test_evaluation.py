"""Evaluation on trajectories made by hand, and with agents whose worth is known."""

import json
import math
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from everystate import evaluation
from everystate.config import Config
from everystate.envs import make
from everystate.envs.ramp_pointmass import region
from everystate.errors import EverystateError
from everystate.evaluation import aggregate, metrics, suites
from everystate.evaluation.perturbations import GRID
from everystate.presets import preset
from everystate.skills import SKILLS

ROOT = Path(__file__).parents[1]
CONFIG = preset("test")


class Scripted:
    """Knows the map: round to the foot of the ramp, up along the east wall, along the ledge."""

    config: Config = CONFIG

    def act(self, observation: Any, goal: Any, *, plan: bool = False, seed: int = 0) -> np.ndarray:
        target = np.array([waypoint(s, g) for s, g in zip(observation, goal, strict=True)])
        return np.clip((target - observation) / 0.1, -1, 1)

    def steps_to_goal(self, observation: Any, goal: Any) -> np.ndarray:
        return np.abs(observation - goal).max(axis=-1) / 0.1


class Idle(Scripted):
    def act(self, observation: Any, goal: Any, *, plan: bool = False, seed: int = 0) -> np.ndarray:
        return np.zeros_like(observation)


class Random(Scripted):
    def act(self, observation: Any, goal: Any, *, plan: bool = False, seed: int = 0) -> np.ndarray:
        return np.random.default_rng(seed).uniform(-1, 1, np.shape(observation))


def waypoint(s: np.ndarray, g: np.ndarray) -> np.ndarray:
    here, there = str(region(s)), str(region(g))
    if here == there == "floor" and (s[0] > 0.45 or s[1] < -0.6) == (g[0] > 0.45 or g[1] < -0.6):
        return g
    if here == "floor" and s[0] < 0.45 and s[1] > -0.68 and (there != "floor" or g[0] > 0.45):
        return np.array([min(s[0], 0.35), -0.8])
    if here == "floor" and there != "floor" and s[0] < 0.85:
        return np.array([0.92, -0.8])
    if here == "ramp" and there == "ledge":
        return np.array([0.92, 0.85])
    if here == "ledge" and there == "ramp" and s[0] < 0.85:
        return np.array([0.92, 0.85])
    return g


@pytest.fixture(scope="module")
def perfect() -> dict[str, Any]:
    return evaluation.evaluate(Scripted())


@pytest.mark.parametrize("plan", [False, True])
def test_steps_are_counted_to_their_end(plan: bool) -> None:
    told: list[tuple[int, int, float]] = []
    options = {"episodes": 2, "plan": plan, "skills": True, "perturb": True}
    result = evaluation.evaluate(Idle(), **options, on_step=lambda *x: told.append(x))
    steps = int(suites.load("ramp-pointmass").subset(2).horizons.max()) * (1 + len(GRID))
    steps += sum(skill.steps for skill in SKILLS["ramp-pointmass"].values())
    steps *= 1 + plan
    assert [done for done, _, _ in told] == [*range(1, steps + 1)]
    assert {of for _, of, _ in told} == {steps}
    shares = [share for _, _, share in told]
    assert shares == sorted(shares)
    assert shares[-1] == 1
    alone = evaluation.evaluate(Idle(), **options)
    assert {n: x for n, x in result.items() if n not in ("time", "command")} == {
        n: x for n, x in alone.items() if n not in ("time", "command")
    }


# --- Metrics on trajectories made by hand ---


ONES = np.ones((1, 2))


def test_distances_are_the_largest_difference_and_the_root_of_the_mean_square() -> None:
    states = np.array([[[0.0, 0.0]], [[1.0, 0.5]], [[2.0, 3.0]]])
    apart = metrics.differences(states, np.array([[2.0, 0.0]]), np.array([2.0, 0.5]))
    np.testing.assert_allclose(metrics.largest(apart, ONES)[:, 0], [1.0, 1.0, 6.0])
    expected = [np.sqrt(0.5), np.sqrt(0.625), np.sqrt(18.0)]
    np.testing.assert_allclose(metrics.rms(apart, ONES)[:, 0], expected)


def test_a_component_without_weight_does_not_count() -> None:
    apart = np.array([[[3.0, 4.0]], [[0.5, 9.0]]])
    asked = np.array([[1.0, 0.0]])
    np.testing.assert_allclose(metrics.largest(apart, asked)[:, 0], [3.0, 0.5])
    np.testing.assert_allclose(metrics.rms(apart, asked)[:, 0], [3.0, 0.5])
    np.testing.assert_allclose(metrics.rms(apart, np.array([[1.0, 3.0]]))[0, 0], np.sqrt(57 / 4))


def test_angles_are_compared_the_short_way() -> None:
    angular, sigma = np.array([True, False]), np.ones(2)
    states, goals = np.array([[[3.1, 3.1]]]), np.array([[-3.1, 3.1]])
    found = metrics.differences(states, goals, sigma, angular)
    np.testing.assert_allclose(found[0, 0], [2 * math.pi - 6.2, 0.0])
    assert metrics.differences(states, goals, sigma)[0, 0, 0] == pytest.approx(6.2)
    turned = metrics.differences(states + np.array([4 * math.pi, 0.0]), goals, sigma, angular)
    assert turned[0, 0, 0] == pytest.approx(2 * math.pi - 6.2)


def test_readings_stop_at_each_goals_horizon() -> None:
    distance = np.array([[0.9, 0.1], [0.2, 0.1], [0.3, 0.9], [0.1, 0.9]])
    found = metrics.readings(distance, np.array([3, 2]), 0.25)
    np.testing.assert_allclose(found["hit"], [1, 1])
    np.testing.assert_allclose(found["end"], [0, 1])
    np.testing.assert_allclose(found["at"], [1 / 3, 1])
    np.testing.assert_allclose(metrics.readings(distance, np.array([4, 4]), 0.25)["end"], [1, 0])


def test_success_is_told_by_group_and_tolerance() -> None:
    distance = np.array([[0.2, 0.4, 0.7, 2.0]])
    low = np.array([True, True, False, False])
    groups = {"low": low, "high": ~low, "all": low | ~low}
    found = metrics.success(distance, np.ones(4, dtype=int), groups)
    assert list(found) == ["low", "high", "all"]
    ends = {eps: row["end"] for eps, row in found["low"].items()}
    assert ends == {"0.25": 0.5, "0.5": 1.0, "1": 1.0}
    assert [found["all"][eps]["hit"] for eps in ("0.25", "0.5", "1")] == [0.25, 0.5, 0.75]


def test_the_closest_approach_is_told_by_pose_and_velocity() -> None:
    # Nearest in all components at the second step; nearer in pose at the third, beyond the horizon.
    apart = np.array([[[4.0, 4.0]], [[0.6, 0.8]], [[0.0, 0.1]]])
    found = metrics.approach(apart, ONES, np.array([False, True]), np.array([2]))
    np.testing.assert_allclose(found, [[np.sqrt(0.5)], [0.6], [0.8]])
    medians = metrics.medians(found, {"all": np.array([True])})
    assert medians["all"]["velocity"] == pytest.approx(0.8)
    still = metrics.approach(apart, ONES, np.array([False, False]), np.array([2]))
    assert metrics.medians(still, {"all": np.array([True])})["all"]["velocity"] is None


def test_first_steps_and_calibration() -> None:
    distance = np.array([[0.2, 0.9, 0.9], [0.1, 0.9, 0.2], [0.9, 0.9, 0.1]])
    measured = metrics.first_steps(distance, np.array([3, 3, 1]), 0.25)
    np.testing.assert_array_equal(measured, [1, np.nan, np.nan])
    found = metrics.calibration(np.array([2.0, 4.0, 9.0, 5.0]), np.array([1.0, 2.0, 3.0, np.nan]))
    assert found == {"mae": pytest.approx(3.0), "spearman": pytest.approx(1.0), "reached": 3}
    nothing = metrics.calibration(np.ones(2), np.full(2, np.nan))
    assert nothing == {"mae": None, "spearman": None, "reached": 0}
    assert metrics.calibration(np.ones(4), np.arange(4.0))["spearman"] is None


def test_rate_counts_only_steps_within_the_horizon() -> None:
    events = np.array([[True, True], [False, True]])
    assert metrics.rate(events, np.array([2, 1])) == pytest.approx(2000 / 3)


# --- Agents whose worth is known ---


def test_an_agent_that_knows_the_map_reaches_nearly_all(perfect: dict[str, Any]) -> None:
    policy = perfect["suites"]["rest"]["policy"]
    for name in ("floor", "ramp", "ledge"):
        row = policy["success"]["max"][name]
        assert row["0.5"]["end"] >= 0.95, name
        assert row["0.25"]["hit"] >= 0.95, name
        assert 0.4 < row["0.5"]["at"] < 1.0, name
        assert row["0.25"]["end"] <= row["0.5"]["end"] <= row["1"]["end"]
        assert policy["position_only"][name]["0.5"]["end"] >= row["0.5"]["end"]
        assert policy["closest"][name]["nearest"] < 0.1
        assert policy["closest"][name]["velocity"] is None  # it has none
    assert (
        perfect["score"] == policy["score"]["all"] == policy["success"]["max"]["all"]["0.5"]["end"]
    )
    assert policy["calibration"]["reached"] > 180
    assert policy["calibration"]["spearman"] > 0.3


def test_success_can_be_told_anew_from_what_is_kept_of_each_task(perfect: dict[str, Any]) -> None:
    policy = perfect["suites"]["rest"]["policy"]
    for measure in ("max", "rms"):
        for reading, kept in (("hit", "nearest"), ("end", "end")):
            near = np.array(policy["tasks"][f"{measure}_{kept}"]) <= 0.5
            told = policy["success"][measure]["all"]["0.5"][reading]
            assert near.mean() == pytest.approx(told)


@pytest.mark.parametrize("useless", [Idle(), Random()])
def test_useless_agents_score_about_nothing(useless: Scripted) -> None:
    found = evaluation.evaluate(useless)["suites"]["rest"]["policy"]["success"]["max"]
    assert found["all"]["0.25"]["end"] < 0.1
    assert found["ledge"]["0.5"]["end"] < 0.2


def test_standing_below_the_ledge_is_not_reaching_it() -> None:
    suite = suites.load("ramp-pointmass")
    scored = make("ramp-pointmass", 1, 0).scored
    below, above = np.array([[0.0, 0.55]]), np.array([[0.0, 0.7]])
    at = suite.mask(suite.position)
    assert metrics.differences(scored(below)[None], scored(above), suite.sigma).max() > 1
    assert metrics.differences(below[None], above, suite.sigma[at]).max() < 0.5


def test_the_same_seed_gives_the_same_result(perfect: dict[str, Any]) -> None:
    def told(result: dict[str, Any]) -> dict[str, Any]:
        return {name: value for name, value in result.items() if not name.startswith("time")}

    assert told(evaluation.evaluate(Scripted())) == told(perfect)
    other = evaluation.evaluate(Scripted(), seed=1)
    calibrations = [one["suites"]["rest"]["policy"]["calibration"] for one in (other, perfect)]
    assert calibrations[0] != calibrations[1]


def test_planning_has_its_own_column_and_its_own_noise_each_step() -> None:
    seeds: dict[bool, list[int]] = {False: [], True: []}

    class Recorded(Idle):
        def act(
            self, observation: Any, goal: Any, *, plan: bool = False, seed: int = 0
        ) -> np.ndarray:
            seeds[plan].append(seed)
            return np.full_like(observation, 0.1 if plan else 0.0)

    found = evaluation.evaluate(Recorded(), plan=True, episodes=20)["suites"]["rest"]
    assert found["tasks"] == 20
    assert found["planning"].keys() == found["policy"].keys()
    assert found["planning"]["score"].keys() == {"floor", "ramp", "ledge", "all"}
    assert len(set(seeds[True])) == len(seeds[True]) == 120
    with pytest.raises(EverystateError, match="episodes is 201"):
        evaluation.evaluate(Recorded(), episodes=201)


def test_results_are_json_and_say_where_they_come_from(perfect: dict[str, Any]) -> None:
    agent = Idle()
    agent.config = replace(CONFIG, weight_clip=math.inf)
    found = evaluation.evaluate(agent, episodes=3)
    again = json.loads(json.dumps(found, allow_nan=False))
    assert again == found
    assert float(found["config"]["weight_clip"]) == math.inf
    assert {"command", "commit", "machine", "versions", "seed", "time"} <= found.keys()


@pytest.mark.parametrize(
    ("typed", "said"),
    [
        (["python", "scripts/one.py", "a b"], "python scripts/one.py 'a b'"),
        (["python", "-m", "scripts", "--seed", "1"], "python -m scripts --seed 1"),
        (["python", "-m", "scripts.one"], "python -m scripts.one"),
    ],
)
def test_a_command_is_said_as_it_was_typed(typed: list[str], said: str, tmp_path: Path) -> None:
    (tmp_path / "scripts").mkdir()
    for name in ("__init__", "__main__", "one"):
        text = "from everystate.evaluation.provenance import command; print(command())"
        (tmp_path / f"scripts/{name}.py").write_text("" if name == "__init__" else text)
    ran = [sys.executable, *typed[1:]]
    done = subprocess.run(ran, cwd=tmp_path, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == said


def test_coverage_is_the_runs_last(tmp_path: Path) -> None:
    assert evaluation.coverage(None) is None
    assert evaluation.coverage(tmp_path) is None
    lines = [
        {"epoch": 0, "coverage/cells": 3.0},
        {"epoch": 1, "coverage/cells": 7.0, "loss/f": 1.0},
    ]
    (tmp_path / "metrics.jsonl").write_text("\n".join(map(json.dumps, lines)) + "\n")
    assert evaluation.coverage(tmp_path) == {"cells": 7.0}


def test_tables_fit_a_terminal(perfect: dict[str, Any]) -> None:
    rest = perfect["suites"]["rest"]
    both = perfect | {"suites": {"rest": rest | {"planning": rest["policy"]}}}
    both["skills"] = {"starts": 100, "policy": {"climb": 0.5}, "planning": {"climb": 1.0}}
    console = Console(width=80, record=True)
    for table in evaluation.tables(both):
        console.print(table)
    text = console.export_text()
    assert all(
        word in text for word in ("floor", "ramp", "ledge", "all", "falls", "climb", "100 %")
    )
    assert "…" not in text
    assert max(map(len, text.splitlines())) <= 80
    assert len(list(evaluation.tables(perfect))) == 1


def test_what_a_run_logs_tells_rest_from_motion_and_pose_from_velocity() -> None:
    class Hangs(Idle):
        config = preset("test", "cartpole")

        def act(
            self, observation: Any, goal: Any, *, plan: bool = False, seed: int = 0
        ) -> np.ndarray:
            return np.zeros((len(observation), 1))

    found = evaluation.logged(Hangs())
    assert found["eval/motion/hit@0.5"] == found["eval/motion/score/all"]
    assert found["eval/rest/end@0.5"] == found["eval/rest/score/all"]
    assert found["eval/motion/hit@0.5"] <= found["eval/motion/rms_hit@0.5"]
    assert {"eval/rest/score/upright", "eval/motion/score/k=64"} <= found.keys()
    assert found["eval/rest/score/upright"] == 0.0
    assert found["eval/motion/closest_velocity"] > 0.1


# --- Over seeds ---


def test_summary_of_known_values() -> None:
    found = aggregate.summary([0.0, 1.0, 2.0, 3.0, 100.0])
    assert found["median"] == found["iqm"] == 2.0
    assert 0 <= found["low"] <= 2 <= found["high"] <= 100
    assert aggregate.summary([1.0, 1.0, 1.0])["low"] == 1.0
    assert aggregate.summary([4.0]) == {
        "median": 4.0,
        "iqm": 4.0,
        "low": None,
        "high": None,
        "values": [4.0],
    }
    with pytest.raises(EverystateError, match="finite"):
        aggregate.summary([1.0, float("nan")])


def test_seeds_are_put_together(perfect: dict[str, Any]) -> None:
    def seed(number: int, mae: float | None) -> dict[str, Any]:
        rest = perfect["suites"]["rest"]
        calibration = rest["policy"]["calibration"] | {"mae": mae}
        rest = rest | {"policy": rest["policy"] | {"calibration": calibration}}
        return perfect | {"config": {"seed": number}, "suites": {"rest": rest}}

    found = aggregate.over_seeds([seed(0, 1.0), seed(1, None), seed(2, 3.0)])
    assert found["seeds"] == [0, 1, 2]
    policy = found["suites"]["rest"]["policy"]
    assert policy["calibration"]["mae"]["values"] == [1.0, 3.0]
    last = perfect["suites"]["rest"]["policy"]["success"]["max"]["ledge"]["0.5"]["end"]
    assert policy["success"]["max"]["ledge"]["0.5"]["end"]["values"] == [last] * 3
    assert "tasks" not in policy
    with pytest.raises(EverystateError, match="only once"):
        aggregate.over_seeds([seed(0, 1.0), seed(0, 1.0)])
