"""Training: the loop around the algorithm, and what it keeps on disk."""

from everystate.training.hosts import join, leads
from everystate.training.loop import train
from everystate.training.rundir import default_run_dir
from everystate.training.tracking import Tracker

__all__ = ["Tracker", "default_run_dir", "join", "leads", "train"]
