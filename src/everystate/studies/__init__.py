"""Studies: conditions x seeds, each run in its own process, and what they come to over seeds.

`everystate sweep`, `everystate compare` and the scripts of experiments/ are made of it.
"""

from everystate.studies.comparison import compare, rescore
from everystate.studies.plan import Condition, Study, read
from everystate.studies.pool import complain, run_all
from everystate.studies.runs import Evaluation, Run, Training
from everystate.studies.sweep import sweep, write
from everystate.studies.tables import table
from everystate.studies.timed import Terms

__all__ = [
    "Condition",
    "Evaluation",
    "Run",
    "Study",
    "Terms",
    "Training",
    "compare",
    "complain",
    "read",
    "rescore",
    "run_all",
    "sweep",
    "table",
    "write",
]
