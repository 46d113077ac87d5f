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
from everystate.viewing.curves import over_time
from everystate.viewing.film import journey
from everystate.viewing.report import on_the_map


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

    def render(
        self: MujocoVectorEnv, states: Any, goal: Any, width: int, height: int, along: Any
    ) -> np.ndarray:
        return np.zeros((len(states), height, width, 3), dtype=np.uint8)

    monkeypatch.setattr(MujocoVectorEnv, "render_states", render)


@pytest.mark.usefixtures("drawn")
def test_page_stands_alone_beside_its_pictures(tmp_path: Path, result: dict[str, Any]) -> None:
    run = fake_run(tmp_path / "run <1>")
    page = viewing.report(run, result, agent=Straight())
    text = page.read_text(encoding="utf-8")
    assert page == run / "report" / "index.html"
    names = {path.stem for path in page.parent.glob("*.png")}
    assert names == {
        *("reached-rest", "values", "policy", "goals"),
        *("coverage", "episodes", "replay", "targets", "losses", "evaluation"),
    }
    assert text.count("data:image/png;base64,") == len(names)
    assert text.count("data:image/gif;base64,") == 1
    assert not re.search(r"(src|href)=\"(?!data:)|url\(|<script|https?://", text)
    kept = json.loads((page.parent / "evaluation.json").read_text())
    beside = kept.pop("references")["rest"]
    assert kept == result
    assert beside.keys() == {"random actions", "doing nothing"}
    score = {name: f"{100 * one['score']['all']:.0f} %" for name, one in beside.items()}
    suite = result["suites"]["rest"]
    own, planned = (f"{100 * suite[by]['score']['all']:.0f} %" for by in ("policy", "planning"))
    assert (
        f"By its policy it holds {own} of {suite['tasks']} goals at rest, within 0.5 σ in every"
        f" component (with planning {planned}, random actions {score['random actions']}, doing"
        f" nothing {score['doing nothing']})." in text
    )
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
    (run / "report" / "film.gif").write_text("of an older run")
    (run / "report" / "notes.txt").write_text("mine")
    text = viewing.report(run, result, agent=Straight()).read_text(encoding="utf-8")
    assert "apt-get install libegl1" in text
    assert not (run / "report" / "film.gif").exists()
    assert (run / "report" / "notes.txt").read_text() == "mine"
    assert (run / "report" / "reached-rest.png").stat().st_size > 10_000


@pytest.mark.usefixtures("drawn")
def test_a_run_without_metrics_or_samples_still_has_a_report(
    tmp_path: Path, result: dict[str, Any]
) -> None:
    (tmp_path / "bare").mkdir()
    page = viewing.report(tmp_path / "bare", result, agent=Straight())
    names = {path.stem for path in page.parent.glob("*.png")}
    assert names == {"reached-rest", "values", "policy"}


@pytest.mark.usefixtures("drawn")
def test_an_agent_without_its_run_has_a_report_where_it_is_told(tmp_path: Path) -> None:
    result = evaluation.evaluate("ramp-pointmass", episodes=5)
    with pytest.raises(EverystateError, match="ramp-pointmass is an agent without its run"):
        viewing.report("ramp-pointmass", result)
    page = viewing.report("ramp-pointmass", result, out=tmp_path / "deep" / "report")
    names = {path.stem for path in page.parent.glob("*.png")}
    assert names == {"reached-rest", "values", "policy"}
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


def test_drawing_leaves_the_users_style_alone(tmp_path: Path) -> None:
    before = dict(mpl.rcParams)
    for name in ("a.png", "b.png"):
        plots.save(plots.reached({"policy": [0.1, 0.4]}, "here", "held"), tmp_path / name)
    assert dict(mpl.rcParams) == before
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


def test_a_curve_says_which_share_of_goals_is_within_each_tolerance() -> None:
    ways = {"policy": [0.6, 0.001, 0.2, 99.0], "doing nothing": [3.0, 4.0]}
    (ax,) = plots.reached(ways, "here", "held").axes
    policy, nothing = (np.asarray(ax.lines[i].get_xydata()) for i in range(2))
    assert policy.tolist() == [[0.01, 0], [0.01, 0.25], [0.2, 0.5], [0.6, 0.75], [99, 1], [10, 1]]
    assert nothing[1:3].tolist() == [[3.0, 0.5], [4.0, 1.0]]


def test_a_film_ends_a_second_after_the_goal_is_met() -> None:
    agent = Straight()
    env, suite = envs.make("ramp-pointmass", 1, 0), suites.load("ramp-pointmass")
    held = suite.only(np.flatnonzero(np.array(suite.kinds) == "floor"))
    way = journey(agent, env, held, planning=False)
    assert way.title == "by the policy"
    second = round(1 / (env.control_step or np.nan))
    near = np.flatnonzero(way.distance <= 0.5)
    assert len(way.states) == len(way.goals) == len(way.distance) == near[0] + second + 1
    assert way.steps_to_goal[0] > way.steps_to_goal[near[0]]


def test_a_spike_does_not_flatten_a_curve() -> None:
    steps, calm = np.arange(100.0), np.linspace(1.0, 2.0, 100)
    spiked = np.where(steps == 50, 1e4, calm)
    metrics = {"steps": steps, "calm": calm, "spiked": spiked}
    figure = plots.over_time(metrics, [("calm", {"calm": ""}), ("spiked", {"spiked": ""})])
    assert [ax.get_yscale() for ax in figure.axes] == ["linear", "symlog"]
    assert figure.axes[1].get_ylabel() == "logarithmic beyond 10"
    assert figure.axes[1].get_ylim() == (0.0, 15_000.0)


def test_no_more_curves_than_one_can_tell_apart(tmp_path: Path) -> None:
    run, ks = fake_run(tmp_path / "run"), [f"k={k}" for k in (4, 8, 16, 32, 64)]
    lines = [json.loads(line) for line in (run / "metrics.jsonl").read_text().splitlines()]
    more = {f"eval/motion/score/{group}": 0.5 for group in (*ks, "all")}
    text = "".join(json.dumps(line | more) + "\n" for line in lines)
    (run / "metrics.jsonl").write_text(text)
    (picture,) = [p for p in over_time(run) if p.name == "evaluation"]
    panels = {ax.get_title(loc="left"): ax for ax in picture.draw().axes}
    labels = {str(line.get_label()) for line in panels["suite motion"].lines}
    assert {label for label in labels if label[0] != "_"} == {"k=4", "k=64", "all"}


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
    groups: dict[str, list[Path]] = {"as-it-is": [], "worse": [], "better": []}
    found = {"as-it-is": (0.2, 0.4, 1.0), "worse": (0.6,), "better": (0.7,)}
    for name, rates in found.items():
        for seed, rate in enumerate(rates):
            groups[name].append(tmp_path / name / f"seed{seed}")
            groups[name][-1].mkdir(parents=True)
            result = {"suites": {"rest": {"policy": {"score": {"all": rate}}}}}
            (groups[name][-1] / "evaluation.json").write_text(json.dumps(result))
    (ax,) = figures.settings(groups).axes
    drawn = [np.asarray(line.get_xdata()).tolist() for line in ax.lines]
    dots, bars = [[20.0, 40.0, 100.0], [70.0], [60.0]], [[40.0], [70.0], [60.0]]
    assert drawn == [x for pair in zip(bars, dots, strict=True) for x in pair] + [[40.0, 40.0]]
    assert [label.get_text() for label in ax.get_yticklabels()] == ["as-it-is", "better", "worse"]
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
