"""Static modal derivatives theta_ij = -K^-1 (K'[X_j] X_i): how mode i changes along mode j, without
inertia (eqs. 14-17).
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.errors import AccuracyError

SYMMETRY_TOLERANCE = (
    1e-8  # of K'[X_j] X_i against K'[X_i] X_j; 1e-10 is what exact differentiation gives
)


def all_pairs(labels: Sequence[str]) -> list[str]:
    """The labels of all derivatives of some vectors, each pair once: 1V1V, 1V2V, 1V1S, .."""
    return [first + second for k, first in enumerate(labels) for second in labels[k:]]


def split(label: str) -> tuple[str, str]:
    """The two modes of a derivative label: 1V2S -> 1V, 2S.

    Raises:
        ValueError: it is no such label.
    """
    match = re.fullmatch(r"(\d+[VS])(\d+[VS])", label)
    if match is None:
        raise ValueError(f"{label!r} is no label of a modal derivative, such as 1V1V or 1V2S")
    return match.group(1), match.group(2)


def modal_derivatives(
    vectors: Array,
    labels: Sequence[str],
    wanted: Sequence[str],
    derivative: Callable[[Array, Array], Array],
    inverse: Any,
    total: Callable[[float], float] = float,
) -> Array:
    """Solve for the derivatives that are wanted, each once, all right-hand sides together.

    Args:
        vectors: (local, k) X.
        labels: of the columns of X.
        wanted: labels of derivatives.
        derivative: K'[x] y for two vectors (local,).
        inverse: applies K^-1, or the inverse with the contact displacements held, to (local, k).
        total: sums a number over all ranks.

    Returns:
        (local, wanted) derivatives; their unit is that of X_i X_j per metre.

    Raises:
        AccuracyError: K'[X_j] X_i and K'[X_i] X_j differ by more than `SYMMETRY_TOLERANCE`.
    """
    column = {label: k for k, label in enumerate(labels)}
    rhs = np.zeros((vectors.shape[0], len(wanted)))
    for k, label in enumerate(wanted):
        i, j = (column[part] for part in split(label))
        rhs[:, k] = derivative(vectors[:, j], vectors[:, i])
        if i != j:
            other = derivative(vectors[:, i], vectors[:, j])
            error, size = (
                total(float(np.sum((other - rhs[:, k]) ** 2))),
                total(float(np.sum(other**2))),
            )
            if error > SYMMETRY_TOLERANCE**2 * size:
                raise AccuracyError(
                    f"modal derivative {label} is not symmetric: relative difference {np.sqrt(error / size):.1e}, "
                    f"more than {SYMMETRY_TOLERANCE:.0e}"
                )
    return -inverse.solve(rhs) if len(wanted) else rhs
