"""How well an agent reaches the states of a fixed suite, how safely, and how well it knows."""

from everystate.evaluation.agents import Agent
from everystate.evaluation.evaluate import (
    coverage,
    evaluate,
    perturbed_table,
    rollout,
    skills_table,
    table,
)
from everystate.evaluation.performances import perform, success_rates
from everystate.evaluation.provenance import provenance

__all__ = [
    "Agent",
    "coverage",
    "evaluate",
    "perform",
    "perturbed_table",
    "provenance",
    "rollout",
    "skills_table",
    "success_rates",
    "table",
]
