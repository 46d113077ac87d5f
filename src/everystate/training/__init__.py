"""Training: the loop around the algorithm, and what it keeps on disk."""

from everystate.training.hosts import join
from everystate.training.loop import train
from everystate.training.rundir import default_run_dir

__all__ = ["default_run_dir", "join", "train"]
