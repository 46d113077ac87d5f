"""`python -m everystate` is the command `everystate`."""

import sys

from everystate.cli import main

if __name__ == "__main__":
    sys.exit(main())
