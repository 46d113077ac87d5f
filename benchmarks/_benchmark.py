"""What every benchmark does: options, the machine's name, and the result in print or as JSON."""

import argparse
import json
import os
import platform
from typing import Any


def options(doc: str | None, **more: Any) -> argparse.ArgumentParser:
    """`--json`, and an option for each default given."""
    parser = argparse.ArgumentParser(description=str(doc).splitlines()[0])
    parser.add_argument("--json", action="store_true", help="one JSON object on the last line")
    for name, default in more.items():
        parser.add_argument(f"--{name}", type=type(default), default=default)
    return parser


def machine() -> str:
    """The processor and its cores."""
    return f"{platform.processor() or platform.machine()}, {os.cpu_count()} cores"


def show(result: dict[str, Any], *, as_json: bool) -> None:
    """A line per figure, or one JSON object."""
    if as_json:
        print(json.dumps(result))
    else:
        print(*(f"{name}: {value}" for name, value in result.items()), sep="\n")
