"""What is said of the source is there, and raw results are as they were made."""

import hashlib
import json
import re
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from everystate.evaluation import raw

ROOT = Path(__file__).parents[1]
RESULTS = ROOT / "results"
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


def pins(filename: str) -> dict[str, str]:
    """Canonical name -> version of each pinned line of a requirements file."""
    found = re.findall(r"^([\w.-]+)==(\S+)$", (ROOT / filename).read_text(), re.MULTILINE)
    return {canonicalize_name(name): version for name, version in found}


@pytest.mark.parametrize(
    ("filename", "requirements"),
    [
        ("requirements.txt", PROJECT["dependencies"]),
        ("requirements-dev.txt", PROJECT["optional-dependencies"]["dev"]),
        ("requirements-dev.txt", PROJECT["optional-dependencies"]["bodies"]),
        ("requirements-dev.txt", PROJECT["optional-dependencies"]["onnx"]),
        ("requirements-peers.txt", PROJECT["optional-dependencies"]["peers"]),
        ("requirements-robots.txt", PROJECT["optional-dependencies"]["robots"]),
        ("requirements-scale.txt", PROJECT["optional-dependencies"]["scale"]),
    ],
)
def test_pins_lie_within_the_declared_ranges(filename: str, requirements: list[str]) -> None:
    """A pin outside its range would make the tested environment one no user can install."""
    pinned = pins(filename)
    for requirement in map(Requirement, requirements):
        version = pinned[canonicalize_name(requirement.name)]
        assert requirement.specifier.contains(version), f"{requirement} is pinned to {version}"


def test_every_runtime_package_has_its_notice() -> None:
    notices = (ROOT / "THIRD_PARTY_NOTICES.md").read_text()
    named = {canonicalize_name(name) for name in re.findall(r"^\| ([\w.-]+) \|", notices, re.M)}
    assert set(pins("requirements.txt")) <= named


def test_requirements_name_no_address() -> None:
    """Where packages come from is the reader's setting, not ours."""
    for path in ROOT.glob("requirements*.txt"):
        assert "://" not in path.read_text(), path.name


def test_one_version_is_named_everywhere() -> None:
    cited = re.search(r"^version: (\S+)$", (ROOT / "CITATION.cff").read_text(), re.M)
    latest = re.search(r"^## \[?([\d.]+)", (ROOT / "CHANGELOG.md").read_text(), re.M)
    assert cited is not None
    assert latest is not None
    assert cited[1] == latest[1] == PROJECT["version"]


def test_the_container_makes_what_there_is() -> None:
    """It is built nowhere here: no machine of ours runs containers."""
    text = (ROOT / "Dockerfile").read_text()
    targets = re.findall(r'make", "(\w+)|RUN make (\w+)', text)
    assert {name for pair in targets for name in pair if name} == {"setup", "demo"}
    for package in ("python3.11-venv", "make", "libegl1", "libgl1-mesa-dri"):
        assert package in text
        assert package in (ROOT / "README.md").read_text()
    left_out = (ROOT / ".dockerignore").read_text().split()
    needed = ("pyproject.toml", "README.md", "LICENSE", "src", "requirements.txt", "Makefile")
    assert not set(needed) & set(left_out)


def data_files() -> list[Path]:
    """What results/ has of measurements: all but figures, tables and notes."""
    drawn = {".png", ".mp4", ".md", ".sha256"}
    return [p for p in sorted(RESULTS.rglob("*")) if p.is_file() and p.suffix not in drawn]


def frozen() -> dict[Path, str]:
    """SHA-256 of each result without a header."""
    lines = (RESULTS / "MANIFEST.sha256").read_text().splitlines()
    return {RESULTS / path: digest for digest, path in (line.split("  ", 1) for line in lines)}


def beside_evaluations() -> dict[Path, str]:
    """SHA-256 of the metrics and the acting parts of agents, as their evaluation has them."""
    found = {}
    for path in RESULTS.rglob("evaluation.json"):
        result = json.loads(path.read_text())
        kept = {f"acting/{name}": digest for name, digest in result.get("acting", {}).items()}
        kept |= {"metrics.jsonl": result["metrics"]} if "metrics" in result else {}
        found |= {path.parent / name: digest for name, digest in kept.items()}
    return found


def test_results_are_as_their_programs_wrote_them() -> None:
    """Each has a header with a hash, or its hash stands in a file that has, or in the manifest."""
    listed = frozen() | beside_evaluations()
    for path in data_files():
        if path in listed:
            found = hashlib.sha256(path.read_bytes()).hexdigest()
            assert found == listed[path], f"{path}: see results/README.md"
        else:
            raw.check(path)
            assert path.stat().st_size <= raw.LARGEST, path


def test_every_recorded_script_is_there_or_its_move_is_written_down() -> None:
    moves = re.findall(
        r"^\| `([\w/.]+)`[^|]*\| `([\w/.]+)`", (RESULTS / "README.md").read_text(), re.M
    )
    moved = dict(moves)
    for path in data_files():
        if path.suffix == ".json":
            command = json.loads(path.read_text()).get("command") or ""
            if said := re.match(r"python (?:-m )?([\w/.]+)", command):
                place = moved.get(said[1], said[1])
                module = ROOT / "src" / place.replace(".", "/")
                assert (ROOT / place).is_file() or module.is_dir(), path


def test_every_listed_result_is_there() -> None:
    assert not {path for path in frozen() if not path.exists()}


def test_results_name_no_folder_of_one_machine() -> None:
    foreign = re.compile(rb"(?<![\w.])/(?:work|home|root)/")
    for path in data_files():
        assert not foreign.search(path.read_bytes()), path


def test_what_the_algorithms_page_names_is_in_the_source() -> None:
    """Its table leads from the paper's lines to functions, which get other names and places."""
    source, text = ROOT / "src" / "everystate", (ROOT / "docs" / "algorithm.md").read_text()
    named = set(re.findall(r"`((?:[a-z_]+/)*[a-z_]+\.py): ([A-Za-z_]+)", text))
    assert len(named) > 30
    for file, name in sorted(named):
        (found,) = [p for p in (source / file, source / "learning" / file) if p.is_file()]
        assert re.search(rf"\b{name}\b", found.read_text()), f"{file} has no {name}"
