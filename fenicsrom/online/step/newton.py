"""Newton's method with load steps, for every static equilibrium of the program.

The solid and the 1D beam under static loads and a model under the preload of its contacts
(`fenicsrom.online.step.equilibrium`) share these two functions. They differ in how a correction is
computed and in when it is small enough, so each passes both as functions.
"""

from __future__ import annotations

import logging
from collections.abc import Callable

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.progress import tell

log = logging.getLogger(__name__)

STATIC_TOLERANCE = 1e-9
"""Newton's decrement relative to the work of the load is at most the square of this."""

Correction = tuple[Array, float]
"""Change (n,) of the unknowns, and Newton's decrement |residual · change|, J."""


def newton(
    start: Array,
    correct: Callable[[Array], Correction | None],
    converged: Callable[[Array, float, float, float], bool],
    iterations: int,
    growth: float = np.inf,
    last_resort: float = 0.0,
    decrements: list[float] | None = None,
) -> Array | None:
    """Iterate from a start to an equilibrium.

    Args:
        start: (n,) unknowns.
        correct: gives the correction at u (n,), or None if it cannot be computed.
        converged: says whether u (n,) is accepted. Its arguments are u after the correction, the
            decrement, and the decrements of the first and of the previous iteration (0 at first).
        iterations: largest number of iterations.
        growth: the iteration stops if the decrement exceeds its first value by this factor.
        last_resort: decrement (J) that is accepted after the last iteration.
        decrements: receives the decrement of each iteration, J, in place of what it held.

    Returns:
        The equilibrium (n,), or None.
    """
    u = start.copy()
    first, last = 0.0, 0.0
    noted = [] if decrements is None else decrements
    noted.clear()
    for k in range(iterations):
        correction = correct(u)
        if correction is None:
            log.debug("Newton's method, iteration %d: no correction", k + 1)
            return None
        change, decrement = correction
        noted.append(decrement)
        log.debug("Newton's method, iteration %d: decrement %.3e J", k + 1, decrement)
        first = first or decrement
        if not np.isfinite(decrement) or decrement > growth * first:
            return None
        u += change
        if converged(u, decrement, first, last):
            return u
        last = decrement
    return u if last <= last_resort else None


def small_against_load(decrement: float, first: float, work: float) -> bool:
    """Whether a decrement is small relative to the work of the load and to the first decrement."""
    return decrement <= STATIC_TOLERANCE**2 * max(first, abs(work))


def in_load_steps(
    start: Array, solve: Callable[[Array, float], Array | None], smallest: float
) -> tuple[Array, float]:
    """Follow an equilibrium as the load grows from nothing to all of it, in adaptive steps.

    The first step is the whole load. A step that fails is halved, and a step that succeeds is
    doubled.

    Args:
        start: (n,) equilibrium without the load.
        solve: gives the equilibrium under a fraction of the load, from a nearby equilibrium, or
            None.
        smallest: the iteration stops if a step of at most this fraction fails.

    Returns:
        The last equilibrium (n,), and the fraction of the load that it carries: 1 on success.
    """
    u, reached, step = start, 0.0, 1.0
    while reached < 1.0:
        aim = min(1.0, reached + step)
        trial = solve(u, aim)
        if trial is not None:
            u, reached, step = trial, aim, 2.0 * step
            tell(reached)
        elif step <= smallest:
            break
        else:
            step *= 0.5
    return u, reached
