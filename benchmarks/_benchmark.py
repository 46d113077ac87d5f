"""What every benchmark does: options, the machine's name, and the result in print or as JSON."""

import argparse
import json
import os
import platform
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from everystate.evaluation import raw

COMMITTED = Path(__file__).parents[1] / "results/benchmarks"
_RATIOS = ("ratio_", "fraction_", "flatness_", "real_time")
_TOLERANCE = 1.15


def options(doc: str | None, **more: Any) -> argparse.ArgumentParser:
    """`--json`, `--out`, and an option for each default given."""
    parser = argparse.ArgumentParser(description=str(doc).splitlines()[0])
    parser.add_argument("--json", action="store_true", help="one JSON object on the last line")
    parser.add_argument("--out", type=Path, help="also write it there, as a raw result")
    for name, default in more.items():
        parser.add_argument(f"--{name}", type=type(default), default=default)
    return parser


def machine() -> str:
    """The processor and its cores."""
    return f"{platform.processor() or platform.machine()}, {os.cpu_count()} cores"


def show(result: dict[str, Any], *, as_json: bool, out: Path | None = None) -> None:
    """A line per figure, or one JSON object; and a raw result, in the place of one before it."""
    if out is not None:
        raw.write(out, result, replace=True)
    if as_json:
        print(json.dumps(result))
    else:
        print(*(f"{name}: {value}" for name, value in result.items()), sep="\n")
        say_what_moved(result)


def say_what_moved(result: dict[str, Any]) -> None:
    """Beside the committed result, ratio by ratio: seconds of another machine would say nothing."""
    committed = COMMITTED / f"{result['benchmark']}.json"
    if not committed.exists():
        return print(f"no {committed.name} is committed to compare with")
    before, now = dict(_ratios(json.loads(committed.read_text()))), dict(_ratios(result))
    for name in sorted(before.keys() & now.keys()):
        change = now[name] / before[name] if before[name] else float("nan")
        moved = "" if 1 / _TOLERANCE <= change <= _TOLERANCE else "  <- moved"
        print(f"committed {name}: {before[name]}, now {now[name]} ({change:.2f} x){moved}")


def _ratios(tree: Any, path: str = "") -> Iterator[tuple[str, float]]:
    if isinstance(tree, dict):
        for name, value in tree.items():
            yield from _ratios(value, f"{path}.{name}".lstrip("."))
    elif isinstance(tree, int | float) and path.split(".")[-1].startswith(_RATIOS):
        yield path, float(tree)
