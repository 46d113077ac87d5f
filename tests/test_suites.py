"""Goal suites: what they hold, and what a file of goals may not."""

import json
import runpy
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from everystate.envs import BODIES, make
from everystate.envs.ramp_pointmass import height, region, set_down
from everystate.errors import EverystateError
from everystate.evaluation import measure, metrics, on_the_spot, suite_file, suites
from everystate.evaluation.references import DoNothing
from everystate.evaluation.suite import Suite
from everystate.presets import preset

ROOT = Path(__file__).parents[1]
HEAD = ("body", "name", "split", "notes", "seed", "components", "angular", "position")


ALL = [(body, name) for body in BODIES for name in suites.names(body)]
SPLITS: tuple[suites.Split, ...] = ("report", "tune")


def test_every_body_has_its_suites() -> None:
    assert [
        *(("ramp-pointmass", "rest"), ("cartpole", "rest"), ("cartpole", "motion")),
        *(("ant", "rest"), ("ant", "motion")),
    ] == ALL


@pytest.mark.parametrize(
    "body",
    [pytest.param(b, marks=() if b == "ramp-pointmass" else pytest.mark.slow) for b in BODIES],
)
def test_suites_are_what_their_script_makes(
    body: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(ROOT / "tools")
    main = runpy.run_path(str(ROOT / "tools" / "make_suites.py"))["main"]
    main([body], tmp_path, ["tune"])  # of the two splits only the seed differs
    for name in suites.names(body):
        path = f"{body}/{name}-tune.json"
        made = json.loads((tmp_path / path).read_text())
        kept = json.loads((suites.FOLDER / path).read_text())
        # Another processor rounds a swinging pole into another swing; the rest is the same.
        assert {n: made[n] for n in HEAD} == {n: kept[n] for n in HEAD}
        assert len(made["tasks"]) == len(kept["tasks"])
        np.testing.assert_allclose(made["sigma"], kept["sigma"], rtol=0.01)


@pytest.mark.parametrize(("body", "name"), ALL)
def test_suites_keep_their_rules(body: str, name: str) -> None:
    env = make(body, 1, 0)
    found = {split: suites.load(body, name, split=split) for split in SPLITS}
    for split, suite in found.items():
        assert json.loads((suites.FOLDER / body / f"{name}-{split}.json").read_text())["checksum"]
        assert len(suite.goals) == 200
        begun = suite.begin(make(body, 200, 0), 0)
        apart = metrics.differences(env.scored(begun)[None], env.scored(suite.goals), suite.sigma)
        assert (metrics.largest(apart, suite.weights) > 1).all()
        np.testing.assert_array_equal(suite.weights, 1)
        if name == "motion":  # standing still in the pose is not there
            velocity = suite.mask(suite.velocity)
            speeds = np.abs(suite.goals[:, velocity]) / suite.sigma[velocity]
            assert (speeds.max(axis=1) > 0.2).all()
        else:
            assert not (env.regions(suite.goals) == "moving").any()
    # The two splits ask for other goals, in the same units.
    assert not (found["report"].goals[:, None] == found["tune"].goals).all(axis=-1).any()
    np.testing.assert_array_equal(found["report"].sigma, found["tune"].sigma)


class Replayed:
    """Plays the actions of the path that a task was cut from; then nothing."""

    def __init__(self, suite: Suite, **config: Any) -> None:
        self.config, self.step = preset("test", suite.body, **config), 0
        assert suite.actions is not None
        self.actions = suite.actions

    def act(self, observation: Any, goal: Any, *, plan: bool = False, seed: int = 0) -> np.ndarray:
        idle = np.zeros_like(self.actions[0][0])
        step, self.step = self.step, self.step + 1
        return np.stack([a[step] if step < len(a) else idle for a in self.actions])

    def steps_to_goal(self, observation: Any, goal: Any) -> np.ndarray:
        return np.ones(len(observation))


def hits(suite: Suite, agent: Any, measure_by: str, eps: str) -> float:
    """Share of tasks by the reading that the suite is told by."""
    done = measure(agent, suite, plan=False)
    return done["success"][measure_by]["all"][eps][suite.scored_by[1]]


@pytest.mark.parametrize("split", SPLITS)
@pytest.mark.parametrize("body", ["cartpole", "ant"])
def test_every_goal_in_motion_is_hit_by_its_paths_own_actions_and_not_by_doing_nothing(
    body: str, split: suites.Split
) -> None:
    suite = suites.load(body, "motion", split=split)
    for way in ("max", "rms"):
        assert hits(suite, Replayed(suite), way, "0.25") == 1.0
    assert hits(suite, DoNothing(preset("test", body)), suite.scored_by[0], "0.5") == 0.0
    assert set(suite.k) == {4, 8, 16, 32, 64}
    np.testing.assert_array_equal(suite.horizons, 2 * suite.k + 10)


def test_a_body_whose_options_change_its_state_has_a_suite_made_on_the_spot() -> None:
    slippery = suites.load("ant", options=("friction=0.5",))
    assert slippery.notes == suites.load("ant").notes
    travelling = suites.load("ant", options=("travel=true",))
    assert travelling.name == "rest"
    assert travelling.components[:2] == ("torso_x", "torso_y")
    assert set(travelling.position) | set(travelling.velocity) == set(travelling.components)
    assert len(travelling.velocity) == 14


MARKED = "known_bodies:Marked-v0"


@pytest.fixture(scope="module")
def made() -> dict[str, Suite]:
    """The suites of a body that has none in the package."""
    return {name: suites.load(MARKED, name) for name in ("rest", "motion")}


def test_goals_made_on_the_spot_can_be_reached_and_are_not_for_free(made: dict[str, Suite]) -> None:
    assert suites.names(MARKED) == ("rest", "motion")
    for name, suite in made.items():
        assert len(suite.goals) >= 20
        assert hits(suite, DoNothing(preset("test", MARKED)), "max", "0.5") == 0.0, name
    assert hits(made["motion"], Replayed(made["motion"]), "max", "0.25") == 1.0


def test_suites_made_on_the_spot_differ_by_split_alone(made: dict[str, Suite]) -> None:
    kept = made["motion"]
    on_the_spot._made.cache_clear()
    again, tune = (suites.load(MARKED, "motion", split=split) for split in SPLITS)
    np.testing.assert_array_equal(again.goals, kept.goals)
    assert not np.isin(tune.goals[:, 1], again.goals[:, 1]).any()
    np.testing.assert_array_equal(tune.sigma, again.sigma)


def test_no_goal_made_on_the_spot_asks_for_what_another_copy_is_made_of(
    made: dict[str, Suite],
) -> None:
    for suite in made.values():
        begun = suite.begin(make(MARKED, len(suite.goals), 0), 0)
        np.testing.assert_allclose(begun[:, 1], suite.goals[:, 1])
        assert len(np.unique(begun[:, 1])) > 5


def test_a_body_says_which_suites_it_has_not() -> None:
    with pytest.raises(EverystateError, match="no suite 'rest', as it never comes to rest"):
        suites.load("gymnasium:Pendulum-v1", "rest")
    with pytest.raises(EverystateError, match="needs a goal suite of its own"):
        on_the_spot.suite("ramp-pointmass")


def test_a_gymnasium_body_starts_where_its_suite_says() -> None:
    suite = suites.load(MARKED, "motion")
    env = make(MARKED, len(suite.goals), 3)
    assert suite.starts is not None
    begun = suite.begin(env, 0)
    np.testing.assert_allclose(begun, [s["observation"] for s in suite.starts], rtol=1e-6)
    ways = []
    for _ in range(2):
        suite.begin(env, 0)
        ways.append([env.step(np.ones((len(begun), 1)))[0] for _ in range(5)])
    np.testing.assert_array_equal(ways[0], ways[1])
    other = suites.load(MARKED, "motion", split="tune")
    assert not np.array_equal(other.goals, suite.goals)


def test_ramp_suite_is_spread_and_keeps_off_the_edges() -> None:
    suite = suites.load("ramp-pointmass")
    assert suite.kinds == tuple(region(suite.goals).tolist())
    counts = {name: int(chosen.sum()) for name, chosen in suite.groups.items()}
    assert counts == {"floor": 80, "ramp": 60, "ledge": 60, "all": 200}
    starts = suite.begin(make("ramp-pointmass", 200, 0), 0).astype(float)
    assert (region(starts) == "floor").mean() >= 0.5
    for places in (starts, suite.goals):
        np.testing.assert_allclose(set_down(places), places, atol=1e-5)
    for turn in np.linspace(0, 2 * np.pi, 16):
        beside = suite.goals + 0.099 * np.array([np.cos(turn), np.sin(turn)])
        assert (height(suite.goals) - height(np.clip(beside, -1, 1))).max() < 0.1
    np.testing.assert_allclose(suite.sigma, [0.577, 0.577, 0.209], atol=1e-3)


RAMP = suites.FOLDER / "ramp-pointmass" / "rest-report.json"


def own(change: Any = lambda data: None) -> dict[str, Any]:
    """A suite of one's own: a changed one without a checksum."""
    data = json.loads(RAMP.read_text())
    del data["checksum"]
    change(data)
    return data


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda d: d.pop("sigma"), "'sigma' is missing"),
        (lambda d: d.update(body="ant", tasks=d["tasks"][:1]), "for 'ant', not for"),
        (lambda d: d["tasks"].clear(), "at least 1"),
        (lambda d: d["tasks"][0].update(horizon=0), "horizon is 0"),
        (lambda d: d["tasks"][0].update(goal=[float("nan"), 0]), "goals .* finite"),
        (lambda d: d["tasks"][0].update(weights=[0, 0, 0]), "weight above 0"),
        (lambda d: d["tasks"][0].update(weights=[1, -1, 1]), "weights must be 0 or more"),
        (lambda d: d.update(position=["X"]), "no component 'X'"),
        (lambda d: d.update(checksum="0" * 64), "changed or damaged"),
    ],
)
def test_bad_goal_files_are_refused(change: Any, message: str, tmp_path: Path) -> None:
    path = tmp_path / "goals.json"
    path.write_text(json.dumps(own(change)))
    with pytest.raises(EverystateError, match=message):
        suites.load("ramp-pointmass", path)


def test_goals_written_by_hand_need_little(tmp_path: Path) -> None:
    data = own()
    data["tasks"] = [{"start": [0.0, -0.5], "goal": [0.3, 0.2], "horizon": 50}]
    for name in ("name", "split", "notes", "seed", "angular"):
        del data[name]
    path = tmp_path / "goals.json"
    path.write_text(json.dumps(data))
    suite = suites.load("ramp-pointmass", path)
    np.testing.assert_allclose(suite.begin(make("ramp-pointmass", 1, 0), 0), [[0.0, -0.5]])
    assert suite.kinds == ("all",)
    assert suite_file.from_json(json.loads(suite_file.to_json(suite))).starts == suite.starts


def test_missing_and_broken_goal_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(EverystateError, match="cannot read"):
        suites.load("ramp-pointmass", tmp_path / "none.json")
    with pytest.raises(EverystateError, match=r"no suite 'motion'.*rest"):
        suites.load("ramp-pointmass", "motion")
    (tmp_path / "bad.json").write_text("{")
    with pytest.raises(EverystateError, match="is no goal suite"):
        suites.load("ramp-pointmass", tmp_path / "bad.json")
