"""Static modal derivatives: how a component mode changes along another mode, without inertia.

    θ_ij = −K⁻¹ (K′[X_j] X_i)    (1)

K′[x] is the derivative of the tangent stiffness along x, at the equilibrium. Source: Mashayekhi and
Zucca (2024), eqs. (14) to (17); for the method see Weeger, Wever and Simeon, Int. J. Numer. Methods
Eng. 108, 2016, and Wu, Tiso, Tatsis, Chatzi and van Keulen, Multibody Syst. Dyn. 45, 2019.
"""

import re
from collections.abc import Callable, Sequence

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.progress import tracked
from fenicsrom.reduction.protocols import Inverse


def all_pairs(labels: Sequence[str]) -> list[str]:
    """The labels of all derivatives of some modes, each pair once: 1V1V, 1V2V, 1V1S, ..."""
    return [first + second for k, first in enumerate(labels) for second in labels[k:]]


def split(label: str) -> tuple[str, str]:
    """Split the label of a derivative into its two directions: 1V2S gives 1V and 2S.

    Raises:
        ValueError: the text is not the label of a derivative.
    """
    match = re.fullmatch(r"(\d+[VSPL])(\d+[VSPL])", label)
    if match is None:
        raise ValueError(f"{label!r} is not the label of a modal derivative, such as 1V1V or 1V2S")
    return match.group(1), match.group(2)


def modal_derivatives(
    vectors: Array,
    labels: Sequence[str],
    wanted: Sequence[str],
    derivative: Callable[[Array, Array], Array],
    inverse: Inverse,
) -> Array:
    """Compute modal derivatives by (1), with one block solve.

    Args:
        vectors: (local, k) component modes X.
        labels: (k,) labels of the modes.
        wanted: (w,) labels of the derivatives.
        derivative: gives K′[x] y (local,) for two vectors (local,).
        inverse: K⁻¹, or the inverse with the contact displacements held at zero.

    Returns:
        (local, w) derivatives, in the unit of X_i X_j per metre.
    """
    column = {label: k for k, label in enumerate(labels)}
    rhs = np.zeros((vectors.shape[0], len(wanted)))
    for k, label in enumerate(tracked(wanted)):
        i, j = (column[part] for part in split(label))
        rhs[:, k] = derivative(vectors[:, j], vectors[:, i])
    return -inverse.solve(rhs) if len(wanted) else rhs
