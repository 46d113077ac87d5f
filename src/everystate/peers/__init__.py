"""Other people's agents, and those that learn nothing, as an evaluation wants them.

Stable-Baselines3, and PyTorch with it, are imported by `goal_env.py` and `hindsight.py` alone: they
train peers, and what was trained acts without them.
"""
