"""Many runs, on one machine or a cluster; `tuning.py` alone imports Ray, and late."""

from everystate.scaling.plan import Sweep, read
from everystate.scaling.summary import write
from everystate.scaling.tuning import sweep

__all__ = ["Sweep", "read", "sweep", "write"]
