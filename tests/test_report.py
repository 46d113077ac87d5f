"""The report stands alone, survives what is missing, and touches only its own files."""

import json
import re
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pytest
from jaxtyping import Float

from everystate import envs, evaluation, load, viewing
from everystate.config import Config
from everystate.envs import MujocoVectorEnv
from everystate.errors import EverystateError
from everystate.evaluation import suites
from everystate.presets import preset
from everystate.viewing import figures, plots
from everystate.viewing.report import on_the_map, over_time


class Straight:
    """Goes straight at the goal, as if there were no ramp."""

    config: Config = preset("test")

    def act(self, observation: Any, goal: Any, *, plan: bool = False, seed: int = 0) -> np.ndarray:
        return np.clip((goal - observation) / 0.1, -1, 1).astype(np.float32)

    def steps_to_goal(self, observation: Any, goal: Any) -> np.ndarray:
        return np.abs(observation - goal).max(axis=-1) / 0.1

    def propose_goals(self, n: int, seed: int = 0) -> Float[np.ndarray, "n 2"]:
        return np.random.default_rng(seed).normal(0, 0.6, (n, 2)).astype(np.float32)

    def log_density(self, state: Any) -> np.ndarray:
        return -(np.asarray(state) ** 2).sum(axis=-1)


def fake_run(folder: Path, epochs: int = 80, *, seed: int = 0) -> Path:
    """A run folder of made-up numbers."""
    rng = np.random.default_rng(seed)
    folder.mkdir(parents=True, exist_ok=True)
    lines = []
    for epoch in range(1, epochs + 1):
        progress = 1 - np.exp(-epoch / 20)
        line = {"epoch": float(epoch), "steps": 2500.0 * epoch, "time/elapsed_s": 6.0 * epoch}
        line |= {f"loss/{n}": 3 - 2 * progress + rng.normal(0, 0.2) for n in ("f", "d", "pi", "c")}
        line |= {"loss/V": 10 * rng.uniform(), "coverage/cells": progress}
        line |= {"value/target": -20 * progress, "value/target_min": -60 * progress}
        line |= {f"replay/ess_{n}": 10 ** rng.uniform(1, 4) for n in ("states", "goals")}
        line |= {"episode/length": 40 * rng.uniform(), "episode/reached": progress * rng.uniform()}
        line |= {"episode/ended": float(epoch % 3), "env/falls_per_1000": 3 * rng.uniform()}
        if epoch % 10 == 0:
            line |= {"eval/rest/score/floor": progress, "eval/rest/score/ledge": progress**2}
        lines.append(json.dumps(line))
    (folder / "metrics.jsonl").write_text("\n".join(lines) + "\n")
    (folder / "samples").mkdir(exist_ok=True)
    np.savez(
        folder / "samples" / "000080.npz",
        next_observations=rng.uniform(-1, 1, (200, 2)).astype(np.float32),
        goals=rng.normal(0, 1, (20, 2)).astype(np.float32),
        visited=rng.uniform(size=(20, 20)) < 0.5,
    )
    return folder


@pytest.fixture(scope="module")
def result() -> dict[str, Any]:
    return evaluation.evaluate(Straight(), plan=True)


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pictures of bodies without a GPU, fast."""

    def render(self: MujocoVectorEnv, observations: Any, *_: Any, **__: Any) -> np.ndarray:
        return np.zeros((len(observations), 48, 64, 3), dtype=np.uint8)

    monkeypatch.setattr(MujocoVectorEnv, "render_states", render)


@pytest.mark.usefixtures("drawn")
def test_page_stands_alone_beside_its_pictures(tmp_path: Path, result: dict[str, Any]) -> None:
    run = fake_run(tmp_path / "run <1>")
    page = viewing.report(run, result, agent=Straight())
    text = page.read_text(encoding="utf-8")
    assert page == run / "report" / "index.html"
    names = {path.stem for path in page.parent.glob("*.png")}
    assert names == {
        *("success-rest", "filmstrip", "values", "policy", "goals"),
        *("coverage", "episodes", "replay", "targets", "losses", "evaluation"),
    }
    assert text.count("data:image/png;base64,") == len(names)
    assert not re.search(r"(src|href)=\"(?!data:)|url\(|<script|https?://", text)
    assert json.loads((page.parent / "evaluation.json").read_text()) == result
    assert "run &lt;1&gt;" in text
    assert "Not drawn" not in text
    assert all(word in text for word in ("floor", "ledge", "falls per 1,000", "commit", "config"))


def test_without_graphics_the_page_says_what_to_install(
    tmp_path: Path, result: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    def render(*_: Any, **__: Any) -> np.ndarray:
        raise EverystateError("cannot draw without a screen: `apt-get install libegl1`")

    monkeypatch.setattr(MujocoVectorEnv, "render_states", render)
    run = fake_run(tmp_path / "run")
    (run / "report").mkdir()
    (run / "report" / "filmstrip.png").write_text("of an older run")
    (run / "report" / "notes.txt").write_text("mine")
    text = viewing.report(run, result, agent=Straight()).read_text(encoding="utf-8")
    assert "apt-get install libegl1" in text
    assert not (run / "report" / "filmstrip.png").exists()
    assert (run / "report" / "notes.txt").read_text() == "mine"
    assert (run / "report" / "success-rest.png").stat().st_size > 10_000


@pytest.mark.usefixtures("drawn")
def test_a_run_without_metrics_or_samples_still_has_a_report(
    tmp_path: Path, result: dict[str, Any]
) -> None:
    (tmp_path / "bare").mkdir()
    page = viewing.report(tmp_path / "bare", result, agent=Straight())
    names = {path.stem for path in page.parent.glob("*.png")}
    assert names == {"success-rest", "filmstrip", "values", "policy"}


@pytest.mark.usefixtures("drawn")
def test_an_agent_without_its_run_has_a_report_where_it_is_told(tmp_path: Path) -> None:
    result = evaluation.evaluate("ramp-pointmass", episodes=5)
    with pytest.raises(EverystateError, match="ramp-pointmass is an agent without its run"):
        viewing.report("ramp-pointmass", result)
    page = viewing.report("ramp-pointmass", result, out=tmp_path / "deep" / "report")
    names = {path.stem for path in page.parent.glob("*.png")}
    assert names == {"success-rest", "filmstrip", "values", "policy"}
    exported = load("ramp-pointmass").export(tmp_path / "agent")
    with pytest.raises(EverystateError, match="is an agent without its run"):
        viewing.report(exported, result)


def test_what_planning_does_is_drawn_where_it_was_measured(tmp_path: Path) -> None:
    agent, body = Straight(), Straight.config.body
    for planning, panels in ((False, 1), (True, 2)):
        drawn = on_the_map(
            tmp_path, agent, envs.make(body, 1, 0), suites.load(body), planning=planning
        )
        (policy,) = [picture for picture in drawn if picture.name == "policy"]
        assert len(policy.draw().axes) == panels
        assert ("short search" in policy.caption) == planning


def test_drawing_leaves_the_users_style_alone(tmp_path: Path, result: dict[str, Any]) -> None:
    before = dict(mpl.rcParams)
    plots.save(plots.success_by_group(result["suites"]["rest"]), tmp_path / "a.png")
    plots.save(plots.success_by_group(result["suites"]["rest"]), tmp_path / "b.png")
    assert dict(mpl.rcParams) == before
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


def test_smoothing_keeps_constants_and_skips_gaps() -> None:
    values = np.full(200, 3.0)
    values[50:60] = np.nan
    np.testing.assert_allclose(plots.smooth(values)[np.r_[0:49, 61:200]], 3.0)
    np.testing.assert_array_equal(plots.smooth(np.arange(20.0)), np.arange(20.0))


@pytest.mark.parametrize("over", ["steps", "epoch", "minutes"])
def test_settings_are_compared_from_files_alone(
    tmp_path: Path, result: dict[str, Any], over: figures.Over
) -> None:
    groups = {
        name: [fake_run(tmp_path / f"{name}-{s}", 80 - 30 * s * i, seed=s) for s in range(3)]
        for i, name in enumerate(("quick", "literal"))
    }
    for folder in groups["quick"]:
        (folder / "evaluation.json").write_text(json.dumps(result))
    path = plots.save(figures.comparison(groups, over=over), tmp_path / "comparison.png")
    assert path.stat().st_size > 10_000
    with pytest.raises(EverystateError, match=r"no metrics\.jsonl"):
        figures.comparison({"none": [tmp_path]})


def test_many_settings_are_dots_and_their_medians(tmp_path: Path) -> None:
    groups: dict[str, list[Path]] = {"as-it-is": [], "other": []}
    for name, rates in {"as-it-is": (0.2, 0.4, 1.0), "other": (0.6,)}.items():
        for seed, rate in enumerate(rates):
            groups[name].append(tmp_path / name / f"seed{seed}")
            groups[name][-1].mkdir(parents=True)
            result = {"suites": {"rest": {"policy": {"score": {"all": rate}}}}}
            (groups[name][-1] / "evaluation.json").write_text(json.dumps(result))
    (ax,) = figures.settings(groups).axes
    drawn = [np.asarray(line.get_xdata()).tolist() for line in ax.lines]
    assert drawn == [[40.0], [20.0, 40.0, 100.0], [60.0], [60.0], [40.0, 40.0]]
    assert [label.get_text() for label in ax.get_yticklabels()] == ["as-it-is", "other"]
    (tmp_path / "empty").mkdir()
    with pytest.raises(EverystateError, match=r"no evaluation\.json"):
        figures.settings({"none": [tmp_path / "empty"]})


def test_what_a_body_does_not_have_is_not_drawn(tmp_path: Path) -> None:
    """Without cells to visit there is only the panel of falls; without any fall, no picture."""
    run = fake_run(tmp_path / "run")
    lines = [json.loads(line) for line in (run / "metrics.jsonl").read_text().splitlines()]

    def panels(**changed: float) -> dict[str, int]:
        kept = [{n: x for n, x in line.items() if n != "coverage/cells"} for line in lines]
        text = "".join(json.dumps(line | changed) + "\n" for line in kept)
        (run / "metrics.jsonl").write_text(text)
        return {p.name: sum(ax.axison for ax in p.draw().axes) for p in over_time(run)}

    assert panels()["coverage"] == 1
    assert "coverage" not in panels(**{"env/falls_per_1000": 0.0})


def test_actions_are_arrows_only_where_they_have_two_components(tmp_path: Path) -> None:
    class Pushes(Straight):
        config = preset("test", "gymnasium:MountainCarContinuous-v0")

    body = Pushes.config.body
    drawn = on_the_map(tmp_path, Pushes(), envs.make(body, 1, 0), suites.load(body))
    assert [picture.name for picture in drawn] == ["values"]
    assert drawn[0].draw().axes


def test_skills_of_several_settings_are_medians_over_their_seeds(tmp_path: Path) -> None:
    folders = []
    for seed, rate in enumerate((0.2, 0.4, 1.0)):
        folders.append(tmp_path / f"seed{seed}")
        folders[-1].mkdir()
        result = {"skills": {"planning": {"balance": rate, "spin": 1.0}}}
        (folders[-1] / "evaluation.json").write_text(json.dumps(result))
    (empty := tmp_path / "empty").mkdir()
    figure = figures.skill_rates({"three": folders, "none": [empty]})
    (ax,) = figure.axes
    assert [text.get_text() for text in ax.texts] == ["40", "100"]
    assert [label.get_text() for label in ax.get_yticklabels()] == ["three (3)"]
    with pytest.raises(EverystateError, match="evaluate --skills"):
        figures.skill_rates({"none": [empty]})


def test_skills_over_training_are_in_the_order_of_their_epochs() -> None:
    runs = {"a": {"100": {"balance": 1.0}, "20": {"balance": 0.5}}}
    (ax,) = figures.skills_over_training(runs).axes
    (line,) = ax.lines
    assert np.asarray(line.get_xydata()).tolist() == [[20, 0.5], [100, 1.0]]
