"""How well an agent reaches the states of fixed suites, how safely, and how well it knows."""

from everystate.evaluation.agents import Agent, warn_of_another_model
from everystate.evaluation.evaluate import coverage, described, evaluate, logged
from everystate.evaluation.measure import apart_from, measure, rollout
from everystate.evaluation.performances import perform, success_rates, successes
from everystate.evaluation.provenance import provenance
from everystate.evaluation.references import DoNothing, RandomActions, references
from everystate.evaluation.tables import tables

__all__ = [
    "Agent",
    "DoNothing",
    "RandomActions",
    "apart_from",
    "coverage",
    "described",
    "evaluate",
    "logged",
    "measure",
    "perform",
    "provenance",
    "references",
    "rollout",
    "success_rates",
    "successes",
    "tables",
    "warn_of_another_model",
]
