"""How well an agent reaches the states of a fixed suite, how safely, and how well it knows."""

from everystate.evaluation.evaluate import Agent, coverage, evaluate, rollout, table
from everystate.evaluation.provenance import provenance

__all__ = ["Agent", "coverage", "evaluate", "provenance", "rollout", "table"]
