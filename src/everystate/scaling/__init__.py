"""What takes more than one machine, or one run: sweeps and collectors, on Ray, imported late."""

from everystate.scaling.collectors import on_ray
from everystate.scaling.plan import Evaluation, Sweep, Trial, read
from everystate.scaling.summary import write
from everystate.scaling.tuning import run_all, sweep

__all__ = ["Evaluation", "Sweep", "Trial", "on_ray", "read", "run_all", "sweep", "write"]
