"""One run of a study, in a process of its own; `pool.py` starts it and says what it is to do."""

import os
import pickle
import signal
import sys
from threading import Thread

from everystate.errors import EverystateError


def main() -> int:
    """Returns the exit code."""
    # Ignored where the study was started in the background of a script; the pool asks by it all the
    # same, and so does the clock of a run that ends by time.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    task, folder, typed = pickle.load(sys.stdin.buffer)
    Thread(target=_end_with_the_study, daemon=True).start()
    try:
        task(folder, typed)
    except EverystateError as error:
        print("error:", " ".join(str(error).split()), file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130
    return 0


def _end_with_the_study() -> None:
    """Standard input ends when the study's process does, however it ends.

    A run that outlived it would still have its folder when the same command goes on. Runs bear to
    be killed.
    """
    os.read(0, 1)
    os._exit(1)


if __name__ == "__main__":
    sys.exit(main())
