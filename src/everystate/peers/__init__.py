"""Our agent beside others, in one harness: `everystate compare`.

Stable-Baselines3, and PyTorch with it, are imported by `goal_env.py` and `hindsight.py` alone.
"""

from everystate.peers.compare import compare
from everystate.peers.contest import Terms
from everystate.peers.contestants import CONTESTANTS

__all__ = ["CONTESTANTS", "Terms", "compare"]
