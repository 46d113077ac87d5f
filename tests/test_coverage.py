"""Cells of the body's space that were ever visited."""

import numpy as np

from everystate.training import coverage


def test_coverage_counts_cells_once() -> None:
    low, high = np.array([-1.0, 0.0]), np.array([1.0, 2.0])
    none = coverage.no_cells(low, high)
    states = np.array([[[-1.0, 0.0], [-0.95, 0.05]], [[1.0, 2.0], [9.0, 9.0]]])
    visited = coverage.visit(none, states, low, high)
    assert visited[0, 0]
    assert visited[-1, -1]
    assert visited.sum() == 2
    assert coverage.visit(visited, states, low, high).sum() == 2
    assert none.sum() == 0, "the grid of a snapshot must not change under it"


def test_bodies_too_large_for_a_grid_have_none() -> None:
    for low, high in ((-np.ones(4), np.ones(4)), (np.array([-np.inf]), np.array([1.0]))):
        nothing = coverage.no_cells(low, high)
        assert coverage.visit(nothing, np.zeros((5, low.size)), low, high).size == 0
