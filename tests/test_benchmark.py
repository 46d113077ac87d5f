"""The suites as environments for anybody's agent, and what becomes of a recording of it."""

import importlib
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
import safetensors.numpy
from gymnasium.utils.env_checker import check_env
from gymnasium.wrappers.vector import DictInfoToList

import everystate
from everystate import benchmark, cli, evaluation
from everystate.benchmark import ENVIRONMENTS, GoalEnv, GoalVectorEnv, recording
from everystate.envs import BODIES, make
from everystate.errors import EverystateError
from everystate.evaluation import metrics, suite_file, suites

MOTION = "everystate/CartpoleMotion-v1"
# A suite that changes is another version: -v2, with all that was measured on -v1 left to it.
FROZEN = {
    "ramp-pointmass/rest-report": "2b35729bbf99",
    "ramp-pointmass/rest-tune": "933f0c13e34e",
    "cartpole/rest-report": "828fbbe8ed95",
    "cartpole/rest-tune": "2913ccecd4ba",
    "cartpole/motion-report": "556fa575169b",
    "cartpole/motion-tune": "162c7c552ede",
    "ant/rest-report": "65508f2fa064",
    "ant/rest-tune": "401e9a2fba02",
    "ant/motion-report": "2040dad6b939",
    "ant/motion-tune": "4ea409c6967e",
    "ant/parts-motion-report": "98bc4f14992e",
    "ant/parts-motion-tune": "44cd2ad28d6d",
    "ant/parts-report": "9b1decbf1833",
    "ant/parts-tune": "6aa101afd8fa",
    "cartpole/parts-motion-report": "0eb68e467162",
    "cartpole/parts-motion-tune": "88db5c6fa6c5",
    "cartpole/parts-report": "b0326dbdf892",
    "cartpole/parts-tune": "5ba239d19642",
    "ramp-pointmass/parts-report": "87fad068d60e",
    "ramp-pointmass/parts-tune": "a9c1ca37a298",
}


@pytest.fixture
def own(tmp_path: Path) -> Path:
    """Three tasks of the cartpole, the last of which asks for the pole alone."""
    names = ["cart", "cos_pole", "sin_pole", "cart_velocity", "pole_velocity"]
    hanging, up = [0, -1, 0, 0, 0], [0.5, 1, 0, 0, 0]
    path = tmp_path / "goals.json"
    path.write_text(
        json.dumps(
            {
                "body": "cartpole",
                "components": names,
                "sigma": [0.9, 0.84, 0.54, 1.0, 4.4],
                "position": names[:3],
                "tasks": [
                    {"start": hanging, "goal": up, "horizon": 5},
                    {"start": hanging, "goal": hanging, "horizon": 3},
                    {"start": hanging, "goal": up, "horizon": 4, "weights": [0, 1, 1, 0, 1]},
                ],
            }
        )
    )
    return path


def test_every_suite_has_an_environment_of_its_name() -> None:
    every = [(body, name) for body in BODIES for name in suites.names(body)]
    assert list(ENVIRONMENTS.values()) == every
    for id in ENVIRONMENTS:
        env = gymnasium.make(id, split="report").unwrapped
        assert isinstance(env, GoalEnv)
        assert (env.vector.suite.body, env.vector.suite.name) == ENVIRONMENTS[id]
        assert env.vector.suite.split == "report"


def test_suites_are_those_of_this_version() -> None:
    found = {
        f"{path.parent.name}/{path.stem}": json.loads(path.read_text())["checksum"][:12]
        for path in suites.FOLDER.rglob("*.json")
    }
    assert found == FROZEN


@pytest.mark.filterwarnings("ignore:.*Box observation space .* value is -?infinity")
@pytest.mark.parametrize("id", ENVIRONMENTS)
def test_gymnasiums_own_checker_passes(id: str) -> None:
    for split in ("tune", "report"):
        check_env(gymnasium.make(id, split=split).unwrapped, skip_render_check=True)


@pytest.mark.peers
def test_stable_baselines_own_checker_passes() -> None:
    checker = importlib.import_module("stable_baselines3.common.env_checker")
    for id in ENVIRONMENTS:
        checker.check_env(gymnasium.make(id).unwrapped)


# --- Episodes ---


def test_an_episode_is_a_task_of_the_suite() -> None:
    env, suite = gymnasium.make(MOTION, split="report"), suites.load("cartpole", "motion")
    starts = suite.begin(make("cartpole", 200, 0), 0)
    for task in (0, 1, 2, 77):
        observation, info = env.reset(options={"task": 77} if task == 77 else None)
        assert info["task"] == task
        np.testing.assert_array_equal(observation["observation"], starts[task])
        np.testing.assert_allclose(observation["desired_goal"], suite.goals[task], rtol=1e-6)
        for step in range(1, suite.horizons[task] + 1):
            _, _, terminated, truncated, _ = env.step(env.action_space.sample())
            assert not terminated
            assert truncated == (step == suite.horizons[task])


def test_tasks_to_report_come_in_order_and_those_to_tune_by_are_drawn() -> None:
    def tasks(split: str, count: int, seed: int) -> list[int]:
        env = gymnasium.make_vec(MOTION, num_envs=3, split=split)
        rounds = [env.reset(seed=seed)] + [env.reset() for _ in range(count - 1)]
        return np.concatenate([info["task"] for _, info in rounds]).tolist()

    assert tasks("report", 67, 0) == [*range(200), 0]
    drawn = tasks("tune", 20, 0)
    assert drawn == tasks("tune", 20, 0) != tasks("tune", 20, 1)
    assert len(set(drawn)) > 40


def test_bodies_together_go_as_each_alone_and_on_to_their_next_tasks() -> None:
    env = gymnasium.make_vec(MOTION, num_envs=3, split="report")
    assert isinstance(env.unwrapped, GoalVectorEnv)
    suite, rng = env.unwrapped.suite, np.random.default_rng(0)
    observations, info = env.reset(seed=0)
    alone = [gymnasium.make(MOTION, split="report") for _ in range(3)]
    expected = [one.reset(options={"task": i})[0] for i, one in enumerate(alone)]
    over, following = np.zeros(3, dtype=bool), 3
    for _ in range(60):
        actions = rng.uniform(-1, 1, (3, 1)).astype(np.float32)
        observations, rewards, terminated, truncated, info = env.step(actions)
        assert not terminated.any()
        for i, one in enumerate(alone):
            if over[i]:
                expected[i], _ = one.reset(options={"task": following})
                following += 1
                assert (rewards[i], truncated[i]) == (0, False)
            else:
                expected[i], reward, _, ended, told = one.step(actions[i])
                assert (rewards[i], truncated[i]) == (reward, ended)
                assert {n: x[i] for n, x in info.items()} == told
            for name, values in expected[i].items():
                np.testing.assert_array_equal(observations[name][i], values)
        over = truncated
    assert following > 4
    assert (info["task"] >= 2).all()
    assert suite.horizons[:3].max() < 60


def test_a_seed_restarts_order_and_noise() -> None:
    env = gymnasium.make_vec("everystate/RampPointmassRest-v1", num_envs=4, split="report")
    ways = []
    for _ in range(2):
        env.reset(seed=5)
        ways.append([env.step(np.ones((4, 2)))[0]["observation"] for _ in range(5)])
    np.testing.assert_array_equal(ways[0], ways[1])
    env.reset()
    assert (env.step(np.ones((4, 2)))[0]["observation"] != ways[0][0]).all()


def test_infos_are_such_as_gymnasium_splits() -> None:
    _, infos = DictInfoToList(gymnasium.make_vec(MOTION, num_envs=2)).reset(seed=0)
    assert all(info.keys() >= {"task", "max", "rms", "is_success", "hit@0.5"} for info in infos)


def test_the_goal_is_drawn_as_a_ghost() -> None:
    env = GoalEnv(*ENVIRONMENTS[MOTION], render_mode="rgb_array")
    pictures = []
    for task in (0, 1):
        env.reset(options={"task": task})
        pictures.append(env.render())
    first, second = pictures
    assert first is not None
    assert first.shape[2] == 3
    assert (first != second).any()


# --- Rewards and readings ---


def test_the_reward_is_that_of_the_measure_by_which_the_suite_is_told() -> None:
    for id, largest in ((MOTION, True), ("everystate/AntMotion-v1", False)):
        env = GoalEnv(*ENVIRONMENTS[id])
        suite = env.vector.suite
        goals = suite.goals[:4]
        aside = np.zeros_like(goals)
        aside[:, -1] = np.array([0.49, 0.51, 2.0, 3.0]) * suite.sigma[-1]  # in one component
        rewards = env.compute_reward(goals + aside, goals, {})
        assert rewards.tolist() == ([0, -1, -1, -1] if largest else [0, 0, 0, -1])
        assert env.compute_reward(goals[0] + aside[0], goals[0], {}) == 0
        assert env.compute_reward(goals[None, :2], goals[None, :2], [{}] * 2).shape == (1, 2)
        dense = GoalEnv(*ENVIRONMENTS[id], reward="dense")
        expected = np.exp(-(np.array([0.49, 0.51, 2.0, 3.0]) ** 2) / len(suite.sigma)) - 1
        np.testing.assert_allclose(
            dense.compute_reward(goals + aside, goals, {}), expected, atol=1e-5
        )


def test_a_reward_is_computed_anew_from_what_was_observed(own: Path) -> None:
    for suite in ("motion", own):
        env = GoalVectorEnv(3, "cartpole", suite, "report", "dense")
        env.reset(seed=0)
        for _ in range(3):
            observations, rewards, *_, info = env.step(np.ones((3, 1)))
            goals = observations["achieved_goal"], observations["desired_goal"]
            np.testing.assert_array_equal(env.compute_reward(*goals, info), rewards)


def test_components_that_are_not_asked_for_do_not_count_until_hindsight_asks(own: Path) -> None:
    env = GoalVectorEnv(3, "cartpole", own, "report")
    observations, info = env.reset()
    achieved, desired = observations["achieved_goal"], observations["desired_goal"]
    assert desired[2].tolist() == [0.5, 1, 0, 0, 0, 0, 1, 1, 0, 1]
    assert achieved.shape == desired.shape
    assert achieved[:, 5:].tolist() == [[1.0] * 5] * 3
    there = achieved.copy()
    there[:, :5] = [-1, 1, 0, 3, 0]  # the pole is up, and the cart elsewhere
    assert env.compute_reward(there, desired, info).tolist() == [-1, -1, 0]
    assert env.compute_reward(there, there + 0, info).tolist() == [0, 0, 0]
    moved = there.copy()
    moved[:, 0] += 1
    assert env.compute_reward(moved, there, info).tolist() == [-1, -1, -1]


def test_readings_on_the_way_come_to_those_of_the_whole(tmp_path: Path) -> None:
    """By the paths that the tasks were cut from, which hit every goal."""
    env = GoalVectorEnv(200, *ENVIRONMENTS[MOTION], "report")
    suite, last = env.suite, {}
    assert suite.actions is not None
    observations, _ = env.reset(seed=0)
    states, returns = [observations["observation"]], np.zeros(200)
    for step in range(suite.horizons.max()):
        actions = [path[step] if step < len(path) else np.zeros(1) for path in suite.actions]
        observations, rewards, _, truncated, info = env.step(np.stack(actions))
        states.append(observations["observation"])
        returns += np.where(step < suite.horizons, rewards, 0)
        for i in np.flatnonzero(truncated & (step < suite.horizons)):
            last.setdefault(int(i), {name: x[i] for name, x in info.items()})
    path = benchmark.save(tmp_path / "own.safetensors", MOTION, np.stack(states, axis=1))
    policy = benchmark.score(path)["suites"]["motion"]["policy"]
    told = policy["success"]["max"]["all"]
    for eps in metrics.EPS:
        for reading in ("hit", "end", "at"):
            values = [last[i][f"{reading}@{eps:g}"] for i in range(200)]
            assert np.mean(values) == pytest.approx(told[f"{eps:g}"][reading])
    assert [last[i]["is_success"] for i in range(200)] == [True] * 200
    assert policy["score"]["all"] == 1.0
    at = np.array([last[i]["at@0.5"] for i in range(200)])
    np.testing.assert_allclose(returns, -(1 - at) * suite.horizons)
    np.testing.assert_allclose(
        [last[i]["max"] for i in range(200)], policy["tasks"]["max_end"], atol=1e-4
    )


# --- Recordings ---


@pytest.mark.parametrize(
    "id",
    [
        "everystate/RampPointmassRest-v1",  # under noise
        MOTION,
        pytest.param("everystate/AntRest-v1", marks=pytest.mark.slow),
    ],
)
def test_a_recording_of_our_agent_scores_as_its_evaluation(id: str, tmp_path: Path) -> None:
    body, suite = ENVIRONMENTS[id]
    agent = everystate.load(body)

    def act(observations: dict[str, np.ndarray]) -> np.ndarray:
        return agent.act(observations["observation"], observations["desired_goal"])

    found = benchmark.score(benchmark.record(act, id, tmp_path / "ours.safetensors"))
    evaluated = evaluation.evaluate(agent, suite=suite)
    assert found["score"] == evaluated["score"]
    mine, known = (dict(one["suites"][suite]) for one in (found, evaluated))
    assert mine.pop("references").keys() == {"random actions", "doing nothing"}
    for one in (mine, known):
        one["policy"].pop("calibration")  # which asks the agent
    assert mine == known


def test_a_loop_of_ones_own_is_saved_as_what_is_recorded(own: Path, tmp_path: Path) -> None:
    env, ways = GoalEnv("cartpole", own, "report"), []
    for _ in range(3):
        observation, _ = env.reset()
        ways.append([observation["observation"]])
        truncated = False
        while not truncated:
            observation, _, _, truncated, _ = env.step(np.ones(1))
            ways[-1].append(observation["observation"])
    saved = benchmark.save(tmp_path / "saved", MOTION, [np.array(w) for w in ways], suite=own)
    kept = benchmark.record(lambda o: np.ones((3, 1)), MOTION, tmp_path / "recorded", suite=own)
    (suite, states), (other, others) = (recording.read(path, own) for path in (saved, kept))
    assert suite_file.as_json(suite) == suite_file.as_json(other)
    np.testing.assert_array_equal(states, others)
    found = benchmark.score(saved, own)
    assert found["suites"]["own"]["tasks"] == 3
    assert np.isfinite(found["suites"]["own"]["policy"]["tasks"]["max_end"]).all()


def test_the_command_prints_and_writes_what_the_function_returns(
    own: Path, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    path = benchmark.record(lambda o: np.ones((3, 1)), MOTION, tmp_path / "x", suite=own)
    words = ["score", str(path), "--suite", str(own)]
    assert cli.main([*words, "--json", "--out", str(tmp_path / "out.json")]) == 0
    told = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert told["suites"] == json.loads(json.dumps(benchmark.score(path, own)["suites"]))
    assert json.loads((tmp_path / "out.json").read_text())["suites"] == told["suites"]
    assert cli.main(words) == 0
    shown = capsys.readouterr().out
    for text in ("cartpole, suite own, 3 tasks", "recorded", "random actions", "doing nothing"):
        assert text in shown
    assert cli.main([*words, "--out", str(tmp_path / "out.json")]) == 2
    assert "exists already" in capsys.readouterr().err


# --- Mistakes ---


@pytest.mark.parametrize(
    ("make_it", "message"),
    [
        (lambda: gymnasium.make(MOTION, suite="rset"), "did you mean 'rest'"),
        (lambda: GoalVectorEnv(0, "cartpole", "rest"), "num_envs is 0"),
        (lambda: GoalEnv("known_bodies:Marked-v0", "rest"), "body that MuJoCo moves"),
        (lambda: gymnasium.make(MOTION).reset(options={"task": 200}), "task is 200: .* 0 to 199"),
        (lambda: gymnasium.make(MOTION).reset(options={"task": 0.5}), "task is 0.5"),
        (lambda: gymnasium.make_vec(MOTION, 2).reset(options={"task": [1]}), "each of 2 bodies"),
        (lambda: benchmark.save("x", "Cartpole", []), "did you mean|choose one of"),
        (
            lambda: benchmark.save("x", MOTION, []),
            "the ways of 0 tasks: give one for each of .*200",
        ),
        (lambda: benchmark.record(lambda o: o["observation"], MOTION, "x"), "actions have shape"),
    ],
)
def test_a_mistake_is_told_in_one_line(make_it: Any, message: str) -> None:
    with pytest.raises(EverystateError, match=message):
        make_it()


def test_splits_and_rewards_are_suggested_where_types_are_not_checked() -> None:
    script = """
import everystate.benchmark as b
for how in ({"split": "test"}, {"reward": "spars"}):
    try:
        b.GoalEnv("cartpole", "rest", **how)
    except b.vector_env.EverystateError as error:
        print(error)
"""
    words = [sys.executable, "-c", script]
    said = subprocess.run(words, capture_output=True, text=True, check=True).stdout.splitlines()
    assert said == [
        "split is 'test': choose one of: report, tune",
        "reward is 'spars': did you mean 'sparse'?",
    ]


def test_states_that_are_no_ways_to_the_goals_are_not_saved(own: Path, tmp_path: Path) -> None:
    start = np.array([0.0, -1, 0, 0, 0])
    path = tmp_path / "x.safetensors"

    def save(*ways: np.ndarray) -> None:
        benchmark.save(path, MOTION, ways, suite=own)

    still = np.tile(start, (6, 1))
    for bad, message in (
        (
            still[:3],
            "states of task 1 have shape .3, 5.: expected its start and .* 3 steps, .4, 5.",
        ),
        (still[:, :4], r"task 1 have shape \(6, 4\)"),
        (still + 1, "begin .* sigma from the start of task 1"),
        (np.where(np.arange(6)[:, None] == 2, np.nan, still), "finite in task 1 after 2 steps"),
    ):
        with pytest.raises(EverystateError, match=message):
            save(still, bad, still)
    assert not path.exists()
    save(still, still, still)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"checksum": "0" * 64}, "recorded on another 'own' of cartpole: its checksum is 0000"),
        ({"body": "os:system"}, "'os:system', which is no suite of the benchmark"),
        (
            {"states": np.zeros((3, 5, 5), np.float32)},
            r"float32 \(3, 5, 5\): expected .*\(3, 6, 5\)",
        ),
        ({"states": np.zeros((3, 6, 5), np.float32)}, "begin 1.19 sigma from the start of task 0"),
        ({"states": np.zeros((3, 6, 5))}, "float64"),
        ({"split": None}, "is no recording .*split"),
    ],
)
def test_recordings_of_something_else_are_refused(
    change: dict[str, Any], message: str, own: Path, tmp_path: Path
) -> None:
    path = benchmark.record(lambda o: np.ones((3, 1)), MOTION, tmp_path / "x", suite=own)
    with safetensors.safe_open(path, "numpy") as file:
        about, states = dict(file.metadata()), file.get_tensor("states")
    states, about = change.pop("states", states), about | change
    kept = {name: text for name, text in about.items() if text is not None}
    safetensors.numpy.save_file({"states": states}, path, kept)
    with pytest.raises(EverystateError, match=message):
        benchmark.score(path, own)


def test_a_file_that_is_no_recording_is_refused(own: Path, tmp_path: Path) -> None:
    with pytest.raises(EverystateError, match="there is no recording nowhere"):
        benchmark.score("nowhere")
    with pytest.raises(EverystateError, match=r"goals.json is no recording"):
        benchmark.score(own)
    path = benchmark.record(lambda o: np.ones((3, 1)), MOTION, tmp_path / "x", suite=own)
    with pytest.raises(EverystateError, match="name the file of your own by --suite"):
        benchmark.score(path)
