"""Many runs, on one machine or a cluster; `tuning.py` alone imports Ray, and late."""

from everystate.scaling.plan import Evaluation, Sweep, Trial, read
from everystate.scaling.summary import write
from everystate.scaling.tuning import run_all, sweep

__all__ = ["Evaluation", "Sweep", "Trial", "read", "run_all", "sweep", "write"]
