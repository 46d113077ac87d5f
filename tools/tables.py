"""Writes the tables of README.md and docs/ from the raw files of results/.

    python tools/tables.py [--check]

In a document a table stands between `<!-- table: NAME -->` and `<!-- end -->`; what is between them
is written here, and nowhere by hand. `--check` writes nothing, and exits with 1 if a table is not
what the raw files say. A new table is one function with `@table` in a module imported below, and
its two lines in a document.
"""

import argparse
import sys

import table_agents as _agents  # noqa: F401 (a table joins TABLES when its module is imported)
import table_benchmark as _benchmark  # noqa: F401
import table_departures as _departures  # noqa: F401
import table_one_set as _one_set  # noqa: F401
import table_ramp as _ramp  # noqa: F401
from table_cells import ROOT, rewrite


def main() -> int:
    """Rewrites every block, or says which is not as it should be."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--check", action="store_true", help="write nothing; exit 1 on a mismatch")
    check, wrong = parser.parse_args().check, False
    for path in [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]:
        text, stale = rewrite(path)
        for name in stale:
            said = "is not what results/ says: run `make tables`" if check else "written"
            print(f"{path.relative_to(ROOT)}: table {name}: {said}")
        if stale and not check:
            path.write_text(text)
        wrong |= bool(stale)
    return int(check and wrong)


if __name__ == "__main__":
    sys.exit(main())
