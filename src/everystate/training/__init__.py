"""Training: the loop around the algorithm, and what it keeps on disk."""

from everystate.training.hosts import join
from everystate.training.loop import train

__all__ = ["join", "train"]
