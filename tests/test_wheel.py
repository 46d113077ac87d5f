"""The wheel works where the source tree is not: it carries its models and its trained agents."""

import json
import os
import shutil
import site
import subprocess
import sys
import venv
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "src" / "everystate"

pytestmark = pytest.mark.slow


def run(*command: str | Path, cwd: Path) -> str:
    """Its standard output; a failure shows what the program said."""
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    result = subprocess.run(command, cwd=cwd, env=environment, capture_output=True, text=True)
    assert result.returncode == 0, result.stdout + result.stderr
    return result.stdout


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Built from a copy, so that no build folder is left in the tree, nor an old one used."""
    source = tmp_path_factory.mktemp("source")
    shutil.copytree(
        PACKAGE, source / "src" / "everystate", ignore=shutil.ignore_patterns("__pycache__")
    )
    for name in ("pyproject.toml", "README.md", "LICENSE", "THIRD_PARTY_NOTICES.md"):
        shutil.copy(ROOT / name, source / name)
    run(sys.executable, "-m", "build", "--wheel", "--no-isolation", cwd=source)
    (built,) = (source / "dist").glob("*.whl")
    return built


@pytest.fixture(scope="module")
def clean_python(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A fresh environment with the wheel; the other packages are those of this one."""
    folder = tmp_path_factory.mktemp("clean") / "venv"
    venv.create(folder, symlinks=True)
    python = folder / "bin" / "python"
    run(sys.executable, "-m", "pip", "--python", python, "install", "--no-deps", wheel, cwd=folder)
    # After the install, or pip would take the everystate found there for one to replace. A path
    # added by a .pth file has its own .pth files left unread: the editable install stays unseen.
    (site_packages,) = folder.glob("lib/python*/site-packages")
    (site_packages / "others.pth").write_text("\n".join(site.getsitepackages()))
    return python


def test_wheel_holds_every_file_of_the_package(wheel: Path) -> None:
    expected = {
        path.relative_to(PACKAGE.parent).as_posix()
        for path in PACKAGE.rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }
    assert expected <= set(zipfile.ZipFile(wheel).namelist())


def test_wheel_carries_the_licences(wheel: Path) -> None:
    names = {Path(name).name for name in zipfile.ZipFile(wheel).namelist()}
    assert {"LICENSE", "THIRD_PARTY_NOTICES.md"} <= names


def test_installed_body_steps(clean_python: Path, tmp_path: Path) -> None:
    script = """
import gymnasium, everystate.envs
print(everystate.__file__)
body = gymnasium.make("everystate/RampPointmass-v0")
body.reset(seed=0)
body.step(body.action_space.sample())
"""
    origin = run(clean_python, "-c", script, cwd=tmp_path).splitlines()[0]
    assert Path(origin).is_relative_to(clean_python.parents[1]), "not the wheel's package"


def test_installed_command_explains_itself(clean_python: Path, tmp_path: Path) -> None:
    assert "train" in run(clean_python.parent / "everystate", "--help", cwd=tmp_path)


def test_installed_benchmark_scores_what_knows_no_agent_of_ours(
    clean_python: Path, tmp_path: Path
) -> None:
    """Three commands: the wheel's installation, a program of anybody's, and the score."""
    (tmp_path / "mine.py").write_text("""
import numpy as np
import everystate.benchmark

rng = np.random.default_rng(0)
everystate.benchmark.record(
    lambda observations: rng.uniform(-1, 1, (len(observations["observation"]), 1)),
    "everystate/CartpoleMotion-v1",
    "motion.safetensors",
)
""")
    run(clean_python, "mine.py", cwd=tmp_path)
    command = clean_python.parent / "everystate"
    told = run(command, "score", "motion.safetensors", "--json", cwd=tmp_path)
    assert 0 < json.loads(told.splitlines()[-1])["score"] < 0.1


@pytest.mark.parametrize(
    "agent", sorted({path.parent.name for path in PACKAGE.glob("agents/*/*.safetensors")})
)
def test_installed_agent_loads_and_acts(clean_python: Path, tmp_path: Path, agent: str) -> None:
    script = f"""
from pathlib import Path
import everystate, numpy
agent = everystate.load(Path(everystate.__file__).parent / "agents" / {agent!r})
goal = agent.propose_goals(1)[0]
assert numpy.isfinite(agent.act(goal, goal)).all()
"""
    run(clean_python, "-c", script, cwd=tmp_path)
