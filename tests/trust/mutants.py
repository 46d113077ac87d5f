"""Does the suite notice a wrong program? python tests/trust/mutants.py [PER_MODULE] [--survivors].

Changes one place of a module at a time (a number, an operator, a comparison, ... as Cosmic Ray
does), in a copy, and runs the module's own tests there; the rest of the suite would kill some of
those that they let live, but takes too long for so many. Draws so many mutants of every module
below. Writes results/trust/mutants.json as it goes, in which those that lived can be read, and the
commit whose tests judged each; goes on from there where that was this commit. Given `--survivors`,
it judges anew those that lived, as tests may have been added, and all of a module that has changed.
Needs the extra `mutation`.
"""

import argparse
import difflib
import hashlib
import json
import os
import random
import shutil
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path
from queue import Queue
from typing import NamedTuple

from cosmic_ray.ast import ast_nodes, get_ast_from_path
from cosmic_ray.mutating import mutate_code
from cosmic_ray.plugins import get_operator, operator_names

from everystate.evaluation import raw
from everystate.evaluation.provenance import commit

ROOT = Path(__file__).resolve().parents[2]
RESULT = ROOT / "results" / "trust" / "mutants.json"
TESTS = {
    "learning/bijections.py": "test_bijections.py test_flows.py",
    "learning/flows.py": "test_flows.py test_bijections.py",
    "learning/conditional.py": "test_flows.py test_bijections.py",
    "learning/weights.py": "test_weights.py test_replay.py",
    "learning/replay.py": "test_replay.py",
    "learning/search.py": "test_search.py test_policy.py",
    "learning/policy.py": "test_policy.py",
    "training/checkpoint.py": "test_checkpoint.py",
}
TYPES = "BitOr"
"""An operator that is there in annotations only, where changing it is no test of a test."""


class Mutant(NamedTuple):
    """One change of one module."""

    module: str
    operator: str
    occurrence: int


def mutants(module: str) -> list[Mutant]:
    """All there are of a module."""
    tree = get_ast_from_path(ROOT / "src/everystate" / module)
    found = []
    for name in operator_names():
        operator_class = get_operator(name)
        if operator_class.arguments() or TYPES in name:
            continue
        operator = operator_class()
        places = sum(len([*operator.mutation_positions(node)]) for node in ast_nodes(tree))
        found += [Mutant(module, name, i) for i in range(places)]
    return found


def passes(copy: Path, tests: str) -> bool:
    """Whether tests pass in a copy; what never ends does not."""
    files = [f"tests/{name}" for name in tests.split()]
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:randomly", *files]
    environment = os.environ | {
        "PYTHONPATH": str(copy / "src"),
        "JAX_COMPILATION_CACHE_DIR": str(ROOT / ".pytest_cache" / "d" / "jax"),
    }
    try:
        done = subprocess.run(
            command, cwd=copy, env=environment, capture_output=True, text=True, timeout=600
        )
    except subprocess.TimeoutExpired:
        return False
    return done.returncode == 0


def judge(mutant: Mutant, copy: Path) -> dict[str, object]:
    """Whether it was killed, and what it is."""
    path = copy / "src/everystate" / mutant.module
    whole = path.read_text()
    changed = mutate_code(whole, get_operator(mutant.operator)(), mutant.occurrence)
    assert changed is not None, mutant
    path.write_text(changed)
    try:
        killed = not passes(copy, TESTS[mutant.module])
    finally:
        path.write_text(whole)
    lines = difflib.unified_diff(whole.splitlines(), changed.splitlines(), lineterm="", n=0)
    return {"killed": killed, "commit": commit(), "diff": [*lines][2:]}


def name(mutant: Mutant) -> str:
    """Of a mutant of the module as it is now."""
    source = (ROOT / "src/everystate" / mutant.module).read_bytes()
    version = hashlib.sha256(source).hexdigest()[:8]
    return f"{mutant.module} {version} {mutant.operator} {mutant.occurrence}"


def write(judged: dict[str, dict[str, object]]) -> str:
    """Keeps the result so far, and says it in one line."""
    killed = sum(bool(one["killed"]) for one in judged.values())
    said = {"mutants": len(judged), "killed": killed, "share": round(killed / len(judged), 3)}
    for module in TESTS:
        of_it = [one["killed"] for name, one in judged.items() if name.startswith(module)]
        said[module] = f"{sum(map(bool, of_it))} of {len(of_it)}"
    raw.write(RESULT, said | {"judged": judged}, replace=True)
    return json.dumps(said)


def main() -> None:
    """Draws them, judges them on every core, and keeps what came of it."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("per_module", type=int, nargs="?", default=15)
    parser.add_argument("--survivors", action="store_true", help="judge anew those that lived")
    options = parser.parse_args()
    rng = random.Random(0)
    drawn = {
        name(one): one
        for module in TESTS
        for one in rng.sample(mutants(module), options.per_module)
    }
    before = json.loads(RESULT.read_text())["judged"] if RESULT.exists() else {}
    judged = {key: one for key, one in before.items() if key in drawn}
    if options.survivors:
        judged = {key: one for key, one in judged.items() if one["killed"]}
    else:
        judged = {key: one for key, one in judged.items() if one.get("commit") == commit()}
    copies: Queue[Path] = Queue()
    with tempfile.TemporaryDirectory() as folder:
        for i in range(len(os.sched_getaffinity(0))):
            copy = Path(folder) / f"copy{i}"
            for part in ("src", "tests"):
                shutil.copytree(ROOT / part, copy / part)
            shutil.copy(ROOT / "pyproject.toml", copy)
            copies.put(copy)
        for tests in TESTS.values():
            if not passes(copy, tests):
                raise SystemExit(f"{tests} must pass before anything is changed")

        def job(key: str) -> tuple[str, dict[str, object]]:
            copy = copies.get()
            try:
                return key, judge(drawn[key], copy)
            finally:
                copies.put(copy)

        waiting = [key for key in drawn if key not in judged]
        rng.shuffle(waiting)  # so that a part of them says something of all
        with ThreadPoolExecutor(copies.qsize()) as pool:
            for done in as_completed([pool.submit(job, key) for key in waiting]):
                key, one = done.result()
                judged[key] = one
                write(judged)
                print("killed" if one["killed"] else "LIVES", key, flush=True)
    print(write(judged))


if __name__ == "__main__":
    main()
