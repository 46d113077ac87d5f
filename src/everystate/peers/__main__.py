"""One run of a comparison, in a process of its own: FOLDER AGENT SEED play|replay."""

import json
import sys
from pathlib import Path

from everystate.errors import EverystateError
from everystate.peers.contest import Terms, play, replay


def main(folder: str, name: str, seed: str, what: str) -> int:
    """Returns the exit code."""
    written = json.loads((Path(folder) / "terms.json").read_text())
    terms = {name: written[name] for name in Terms._fields}
    terms["options"] = tuple(terms["options"])
    try:
        do = {"play": play, "replay": replay}[what]
        do(name, int(seed), Terms(**terms), Path(folder) / name / f"seed{seed}")
    except EverystateError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
