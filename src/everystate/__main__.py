"""`python -m everystate` is the command `everystate`."""

from everystate.cli import main

if __name__ == "__main__":
    main()
