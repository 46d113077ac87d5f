"""What people look at: pictures and films of agents, and the page that holds them."""

from everystate.viewing.render import render
from everystate.viewing.report import report, report_folder

__all__ = ["render", "report", "report_folder"]
