"""Our agent beside others, in one harness: `everystate compare`.

Stable-Baselines3, and PyTorch with it, are imported by `goal_env.py` and `hindsight.py` alone: they
train peers, and what was trained acts without them.
"""

from everystate.peers.comparison import compare, rescore
from everystate.peers.contest import Terms
from everystate.peers.contestants import CONTESTANTS
from everystate.peers.tables import table

__all__ = ["CONTESTANTS", "Terms", "compare", "rescore", "table"]
