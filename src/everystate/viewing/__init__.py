"""What people look at: pictures of runs, and the page that holds them."""

from everystate.viewing.report import report

__all__ = ["report"]
