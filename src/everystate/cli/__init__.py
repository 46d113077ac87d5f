"""The command line: `everystate COMMAND`."""

from everystate.cli.commands import COMMANDS, main

__all__ = ["COMMANDS", "main"]
