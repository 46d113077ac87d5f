"""Makes the goal suites that `everystate evaluate` uses: python tools/make_suites.py BODY.

Run again on the same machine it writes the same files; the suites in the package were made by it.
"""

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import get_args

from suites_motion import MOVES, motion
from suites_parts import parts
from suites_rest import MAKERS

from everystate.evaluation import suite_file, suites

SPLITS: tuple[suites.Split, ...] = get_args(suites.Split)


def main(
    bodies: list[str], folder: Path = suites.FOLDER, splits: Sequence[suites.Split] = SPLITS
) -> None:
    """Writes every suite of these bodies, or of all, in these splits."""
    for body in bodies or sorted(MAKERS):
        (folder / body).mkdir(exist_ok=True)
        for split in splits:
            made = [MAKERS[body](split), *([motion(body, split)] if body in MOVES else [])]
            made += parts(body, split)
            for suite in made:
                path = folder / body / f"{suite.name}-{split}.json"
                path.write_text(suite_file.to_json(suite))
                print(path, {name: int(chosen.sum()) for name, chosen in suite.groups.items()})


if __name__ == "__main__":
    main(sys.argv[1:])
