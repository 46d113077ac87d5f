"""Raw files of results/ to cells of tables, and tables into documents, for `tables.py`."""

import json
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from statistics import median
from typing import Any

from everystate.evaluation.aggregate import summary
from everystate.evaluation.markdown import markdown

ROOT = Path(__file__).resolve().parent.parent
RESULTS = ROOT / "results"
BLOCK = re.compile(r"(<!-- table: (\S+) -->\n).*?(<!-- end -->)", re.DOTALL)
NONE = "–"
"""Where nothing was measured."""
Rows = list[list[str]]
"""A table: the headings, then the cells of each row."""
Run = dict[str, Any]
TABLES: dict[str, Callable[[], Rows]] = {}


def table(build: Callable[[], Rows]) -> Callable[[], Rows]:
    """Makes a function the table of its name, with dashes."""
    TABLES[build.__name__.replace("_", "-")] = build
    return build


def read(path: str) -> Any:
    """A JSON file of results/."""
    return json.loads((RESULTS / path).read_text())


def runs(study: str, file: str = "evaluation.json") -> list[Run]:
    """What was measured of each seed of a study's setting, by seed."""
    found = sorted(RESULTS.glob(f"{study}/seed*/{file}"), key=lambda p: int(p.parent.name[4:]))
    return [json.loads(path.read_text()) for path in found]


def at(run: Run, *names: str) -> float | None:
    """A number of a result, or None where it has none."""
    found: Any = run
    for name in names:
        found = found.get(name) if isinstance(found, dict) else None
    return found


def values(found: Sequence[Run], *names: str) -> list[float]:
    """That number of each seed that has it."""
    return [x for run in found if (x := at(run, *names)) is not None]


def middle(numbers: Sequence[float], times: float = 100, digits: int = 0) -> str:
    """The median alone."""
    return f"{times * median(numbers):,.{digits}f}" if numbers else NONE


def interval(numbers: Sequence[float], times: float = 100, small: int = 0) -> str:
    """The median and the 90 % interval of the interquartile mean; with decimals below 10."""
    if len(numbers) < 2:
        return middle(numbers, times)
    of = summary(numbers)
    scaled = (times * of[name] for name in ("median", "low", "high"))
    between, low, high = (f"{x:.{0 if x >= 10 else small}f}" for x in scaled)
    return f"{between} [{low}, {high}]"


def rewrite(path: Path) -> tuple[str, list[str]]:
    """A document with all its tables made anew, and the names of those that were not so before."""
    stale: list[str] = []

    def made(block: re.Match[str]) -> str:
        start, name, end = block.groups()
        if name not in TABLES:
            raise SystemExit(f"{path}: there is no table {name!r}")
        heads, *rows = TABLES[name]()
        whole = f"{start}{markdown(heads, rows)}{end}"
        if whole != block[0]:
            stale.append(name)
        return whole

    return BLOCK.sub(made, path.read_text()), stale
