"""When Newton's method of a step stops."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from fenicsrom.online.step.step import contact_decrement, has_converged


def iterations(
    decrements: list[float], quadratic: bool, energy: float = 1.0, rounding: float = 0.0
) -> int:
    """The iteration at which a sequence of decrements ends."""
    last = 0.0
    for k, decrement in enumerate(decrements, start=1):
        if has_converged(decrement, last, k, energy, rounding, quadratic):
            return k
        last = decrement
    return 0


def test_bodies_that_bolts_press_together_leave_the_rounding_of_their_free_displacements() -> None:
    """8 kN carry a displacement of 1.6 µm; without contact forces it would be 3.3 mm."""
    here = np.array([[1.6e-6, 0.0]])
    scratch = SimpleNamespace(space=(0, 0), mean_force=np.array([[8e3, 0.0]]))
    trial = SimpleNamespace(
        contact=SimpleNamespace(x=here),
        scratch=scratch,
        displacement_before=here - np.array([[1e-12, 0.0]]),
        free_displacement=np.array([[3.3e-3, 0.0]]),
    )
    decrement, rounding = contact_decrement.py_func(-9e-9, np.array([0]), trial)
    assert decrement == pytest.approx(1e-9)  # 8 kN over 1 pm less 9 nJ
    assert rounding == pytest.approx(8e3 * 3.3e-3 * 1e-15, rel=1e-9, abs=0.0)
    trial.free_displacement = here
    _, rounding = contact_decrement.py_func(0.0, np.array([0]), trial)
    assert rounding == pytest.approx(8e3 * 1.6e-6 * 1e-14, rel=1e-9, abs=0.0)


def test_decrement_below_the_rounding_of_the_contact_forces_ends_where_it_stays() -> None:
    """Otherwise it wanders until the step fails."""
    wandering = [1e-6, 5e-15, 4e-15, 6e-15]
    assert iterations(wandering, quadratic=False, energy=1e-2, rounding=3e-14) == 3
    assert iterations(wandering, quadratic=False, energy=1e-2) == 0


def test_linear_convergence_ends_where_the_next_decrement_is_small() -> None:
    """The error falls to 1e-2 in each iteration, its square to 1e-4; 1e-14 of it is enough."""
    assert iterations([0.5 * 10.0 ** (-4 * k) for k in range(12)], quadratic=False) == 7


def test_quadratic_convergence_ends_one_iteration_before() -> None:
    """Errors of 1e-2, 1e-4, 1e-8 are followed by 1e-16."""
    assert iterations([1e-4, 1e-8, 1e-16, 1e-32], quadratic=True) == 3
    assert iterations([1e-4, 1e-8, 1e-16, 1e-32], quadratic=False) == 4
