"""Which share of `src/` the fast suite reaches: `python tests/covered.py [PYTEST OPTIONS]`.

Writes results/trust/coverage.json: of every module its statements and how many are never run.
"""

import subprocess
import sys
from pathlib import Path

from coverage import Coverage

from everystate.evaluation import raw

ROOT = Path(__file__).resolve().parents[1]
RESULT = ROOT / "results" / "trust" / "coverage.json"


def main() -> int:
    """Returns the exit code of pytest; nothing is written where a test failed."""
    pytest = [sys.executable, "-m", "pytest", "--cov=everystate", "--cov-report=", *sys.argv[1:]]
    done = subprocess.run(pytest, cwd=ROOT)
    if done.returncode:
        return done.returncode
    measured = Coverage(data_file=ROOT / ".coverage", config_file=ROOT / "pyproject.toml")
    measured.load()
    modules = {}
    for path in sorted((ROOT / "src" / "everystate").rglob("*.py")):
        _, statements, _, missed, _ = measured.analysis2(str(path))
        modules[str(path.relative_to(ROOT))] = {
            "statements": len(statements),
            "missed": len(missed),
        }
    total = {key: sum(one[key] for one in modules.values()) for key in ("statements", "missed")}
    share = round(1 - total["missed"] / total["statements"], 4)
    raw.write(RESULT, {"reached": share, "total": total, "modules": modules}, replace=True)
    print(f"{100 * share:.1f} % of {total['statements']} statements are reached")
    return 0


if __name__ == "__main__":
    sys.exit(main())
