"""When Newton's method of a step stops."""

from __future__ import annotations

from fenicsrom.online.step.step import has_converged


def iterations(decrements: list[float], quadratic: bool) -> int:
    """The iteration at which a sequence of decrements ends, with an energy of 1 J."""
    last = 0.0
    for k, decrement in enumerate(decrements, start=1):
        if has_converged(decrement, last, k, 1.0, 0.0, quadratic):
            return k
        last = decrement
    return 0


def test_decrement_of_cancelling_displacements_ends_where_it_grows() -> None:
    """It wanders at 1e-12 of the energy, but a larger one that grows is no rounding."""
    assert iterations([1e-6, 4e-13, 2e-13, 5e-13, 3e-13], quadratic=True) == 4
    assert iterations([1e-6, 4e-11, 2e-11, 5e-11, 3e-11], quadratic=True) == 0


def test_linear_convergence_ends_where_the_next_decrement_is_small() -> None:
    """The error falls to 1e-2 in each iteration, its square to 1e-4; 1e-14 of it is enough."""
    assert iterations([0.5 * 10.0 ** (-4 * k) for k in range(12)], quadratic=False) == 7


def test_quadratic_convergence_ends_one_iteration_before() -> None:
    """Errors of 1e-2, 1e-4, 1e-8 are followed by 1e-16."""
    assert iterations([1e-4, 1e-8, 1e-16, 1e-32], quadratic=True) == 3
    assert iterations([1e-4, 1e-8, 1e-16, 1e-32], quadratic=False) == 4
