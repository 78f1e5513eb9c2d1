"""When Newton's method of a step stops."""

from __future__ import annotations

import numpy as np
import pytest

from fenicsrom.online.step.step import contact_work, has_converged


def iterations(decrements: list[float], quadratic: bool, tolerance: float = 1e-14) -> int:
    """The iteration at which a sequence of decrements of an energy of 1 J ends."""
    last = 0.0
    for k, decrement in enumerate(decrements, start=1):
        if has_converged(decrement, last, k, 1.0, tolerance, quadratic):
            return k
        last = decrement
    return 0


def test_linear_convergence_ends_where_the_next_decrement_is_small() -> None:
    """The error falls to 1e-2 in each iteration, its square to 1e-4; 1e-14 of it is enough."""
    assert iterations([0.5 * 10.0 ** (-4 * k) for k in range(12)], quadratic=False) == 7
    powers = [0.5 * 10.0 ** (-4 * k) for k in range(12)]
    assert iterations(powers, quadratic=False, tolerance=1e-11) == 6


def test_small_decrement_that_stays_is_rounding() -> None:
    """Otherwise it wanders until the step fails."""
    assert iterations([1e-6, 5e-15, 4e-15, 6e-15], quadratic=False) == 3
    assert iterations([1e-6, 5e-12, 4e-12, 6e-12], quadratic=False) == 0


def test_contact_forces_work_on_the_change_of_the_iteration() -> None:
    """8 kN over 1 pm; the points that are no candidates do not count."""
    force, moved = np.array([[8e3, 0.0], [1.0, 1.0]]), np.array([1e-12, 0.0, 1.0, 1.0])
    found = contact_work.py_func(force, moved, np.array([0]))
    assert found == pytest.approx(8e-9, rel=1e-15)


def test_quadratic_convergence_ends_one_iteration_before() -> None:
    """Errors of 1e-2, 1e-4, 1e-8 are followed by 1e-16."""
    assert iterations([1e-4, 1e-8, 1e-16, 1e-32], quadratic=True) == 3
    assert iterations([1e-4, 1e-8, 1e-16, 1e-32], quadratic=False) == 4
