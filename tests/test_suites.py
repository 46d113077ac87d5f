"""Goal suites: what they hold, and what a file of goals may not."""

import json
import runpy
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from everystate.envs.ramp_pointmass import height, region, set_down
from everystate.errors import EverystateError
from everystate.evaluation import suites

ROOT = Path(__file__).parents[1]


@pytest.mark.parametrize(
    "body", [pytest.param(b, marks=pytest.mark.slow if b == "ant" else ()) for b in suites.SUITES]
)
def test_suites_are_what_their_script_makes(
    body: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(ROOT / "experiments")
    script = runpy.run_path(str(ROOT / "experiments" / "make_suites.py"))
    assert sorted(script["MAKERS"]) == sorted(suites.SUITES)
    script["main"]([body], tmp_path)
    made, kept = suites.load(body, tmp_path / f"{body}.json"), suites.load(body)
    for field in ("notes", "seed", "components", "angular", "position"):
        assert getattr(made, field) == getattr(kept, field)
    np.testing.assert_array_equal(made.horizons, kept.horizons)
    # Another processor rounds a swinging pole into another swing; what is at rest is the same, but
    # for the ant, which came to rest there.
    np.testing.assert_allclose(made.sigma, kept.sigma, rtol=0.01)
    if body != "ant":
        speeds = [i for i, name in enumerate(kept.components) if name.endswith("velocity")]
        at_rest = (kept.goals[:, speeds] == 0).all(axis=1)
        assert at_rest.sum() >= 100
        np.testing.assert_array_equal(made.goals[at_rest], kept.goals[at_rest])


def test_a_body_whose_options_change_its_state_has_a_suite_made_on_the_spot() -> None:
    slippery = suites.load("ant", options=("friction=0.5",))
    assert slippery.notes == suites.load("ant").notes
    travelling = suites.load("ant", options=("travel=true",))
    assert travelling.components[:2] == ("torso_x", "torso_y")


def test_ramp_suite_is_spread_and_keeps_off_the_edges() -> None:
    suite = suites.load("ramp-pointmass")
    assert suite.starts is not None
    names, counts = np.unique(region(suite.goals), return_counts=True)
    assert dict(zip(names.tolist(), counts.tolist(), strict=True)) == {
        "floor": 80,
        "ledge": 60,
        "ramp": 60,
    }
    assert (region(suite.starts) == "floor").mean() >= 0.5
    for places in (suite.starts, suite.goals):
        np.testing.assert_array_equal(set_down(places), places)
    for turn in np.linspace(0, 2 * np.pi, 16):
        beside = suite.goals + 0.099 * np.array([np.cos(turn), np.sin(turn)])
        assert (height(suite.goals) - height(np.clip(beside, -1, 1))).max() < 0.1
    np.testing.assert_allclose(suite.sigma, [0.577, 0.577, 0.209], atol=1e-3)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda d: d.pop("sigma"), "'sigma' is missing"),
        (lambda d: d.update(body="ant"), "for 'ant', not for 'ramp-pointmass'"),
        (lambda d: d["tasks"].clear(), "at least 1"),
        (lambda d: d["tasks"][0].update(horizon=0), "horizon is 0"),
        (lambda d: d["tasks"][0].update(goal=[float("nan"), 0]), "goals .* finite"),
        (lambda d: d.update(position=["X"]), "no component 'X'"),
    ],
)
def test_bad_goal_files_are_refused(change: Any, message: str, tmp_path: Path) -> None:
    data = json.loads((suites.FOLDER / "ramp-pointmass.json").read_text())
    change(data)
    path = tmp_path / "goals.json"
    path.write_text(json.dumps(data))
    with pytest.raises(EverystateError, match=message):
        suites.load("ramp-pointmass", path)


def test_missing_and_broken_goal_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(EverystateError, match="cannot read"):
        suites.load("ramp-pointmass", tmp_path / "none.json")
    (tmp_path / "bad.json").write_text("{")
    with pytest.raises(EverystateError, match="is no goal suite"):
        suites.load("ramp-pointmass", tmp_path / "bad.json")
