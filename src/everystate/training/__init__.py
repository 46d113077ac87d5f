"""Training: the loop around the algorithm, and what it keeps on disk."""

from everystate.training.loop import train

__all__ = ["train"]
