"""The files that say what the package needs agree with one another, and results name no machine."""

import re
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[1]
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
        ("requirements-peers.txt", PROJECT["optional-dependencies"]["peers"]),
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


def test_results_name_commands_that_readers_have() -> None:
    """Not a script, a folder or a worker of the machine that they were made on."""
    ours = re.compile(r"everystate [a-z]+ |python (-m everystate|experiments|tests|benchmarks)[./]")
    foreign = re.compile(r"(?<![\w.])/(?:tmp|work|home|root)/")
    for path in (ROOT / "results").rglob("*.json"):
        for command in re.findall(r'"command": "([^"]*)"', path.read_text()):
            assert ours.match(command), (path, command)
            assert not foreign.search(command), (path, command)
