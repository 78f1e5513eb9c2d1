"""The matrices of a linear superelement, as files of other programs name them."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.errors import ErrorKind, refuse

STIFFNESS, MASS, DAMPING, INTERFACE = "KAAX", "MAAX", "BAAX", "INTERF"
"""Names in Nastran files: the first three as Nastran's EXTSEOUT writes them, the last one is ours.

INTERF has a column for each interface row: the displacement that the row gives is the product of
the transposed column with the coordinates.
"""

NAMES: Mapping[str, tuple[str, ...]] = {
    "stiffness": (STIFFNESS, "KAA", "KXX", "KGG", "KJJ", "K2GG", "K2PP", "K", "STIFFNESS"),
    "mass": (MASS, "MAA", "MXX", "MGG", "MJJ", "M2GG", "M2PP", "M", "MASS"),
    "damping": (DAMPING, "BAA", "BXX", "BGG", "BJJ", "B2GG", "B2PP", "B", "C", "DAMPING"),
    "interface": (INTERFACE, "INTERFACE"),
}
"""Accepted names, in capitals, in the order of preference."""

LARGEST_SIZE = 1000
"""Largest number of coordinates: each time step costs dense operations on all of them."""

SYMMETRY = 1e-6
"""Largest accepted asymmetry relative to the largest entry; some files have seven digits only."""

Label = tuple[int, int]
"""Number of a node and of a direction, 1 to 6, or 0 for a scalar coordinate."""


@dataclass(frozen=True, eq=False)
class MatrixSet:
    """The matrices of n coordinates in a consistent set of SI units.

    Attributes:
        mass: (n, n), symmetric, kg.
        stiffness: (n, n), symmetric, N/m.
        damping: (n, n), kg/s, or None.
        interface: (r, n) rows that give interface displacements; None if these displacements are
            the coordinates themselves.
        labels: (n,) node and direction of each coordinate, or None if the file does not say.
    """

    mass: Array
    stiffness: Array
    damping: Array | None = None
    interface: Array | None = None
    labels: tuple[Label, ...] | None = None


def check_size(path: Path, size: int) -> None:
    """Check a number of coordinates.

    Raises:
        SceneError: there are too many.
    """
    if size > LARGEST_SIZE:
        reason = f"has {size} coordinates; at most {LARGEST_SIZE}: reduce it first (Craig-Bampton)"
        raise refuse(path, reason, ErrorKind.RANGE)


def dense(
    entries: Mapping[tuple[Label, Label], float], labels: tuple[Label, ...], symmetric: bool
) -> Array:
    """The matrix (n, n) of entries by the labels (n,) of their rows and columns.

    Args:
        entries: the numbers; those of other labels are left out.
        labels: node and direction of each coordinate.
        symmetric: whether an entry stands for the one across the diagonal, unless that is given.
    """
    place = {label: k for k, label in enumerate(labels)}
    matrix = np.zeros((len(labels), len(labels)))
    for (row, column), value in entries.items():
        if row in place and column in place:
            matrix[place[row], place[column]] = value
            if symmetric and (column, row) not in entries:
                matrix[place[column], place[row]] = value
    return matrix


def matrix_set(
    path: Path, matrices: Mapping[str, Array], labels: tuple[Label, ...] | None = None
) -> MatrixSet:
    """The checked matrices of a file.

    Args:
        path: the file, for messages.
        matrices: its matrices by name; the interface rows are the columns of theirs.
        labels: (n,) node and direction of each coordinate, if the file says so.

    Raises:
        SceneError: a matrix is missing, or the matrices do not fit together.
    """
    upper = {name.upper(): matrix for name, matrix in matrices.items()}
    found: dict[str, Array] = {}
    for part, names in NAMES.items():
        present = [name for name in names if name in upper]
        if part == "damping":  # a matrix of zeros of any size stands for none
            present = [name for name in present if np.any(upper[name])]
        if not present and part in ("stiffness", "mass"):
            listed = ", ".join(list(upper)[:10]) or "none"
            reason = f"has no {part} matrix: looked for {', '.join(names)}; the file has {listed}"
            raise refuse(path, reason, ErrorKind.MISSING)
        if present:
            found[part] = _checked(path, part, upper[present[0]])
    n = len(found["stiffness"])
    check_size(path, n)
    for part, matrix in found.items():
        if part == "interface" and matrix.shape[0] == n:
            continue
        if matrix.shape != (n, n):
            reason = f"the {part} matrix has the shape {matrix.shape}, the stiffness has {n} rows"
            raise refuse(path, reason, ErrorKind.MISMATCH)
    for part in ("stiffness", "mass"):
        off = float(np.max(np.abs(found[part] - found[part].T), initial=0.0))
        if off > SYMMETRY * float(np.max(np.abs(found[part]), initial=0.0)):
            raise refuse(path, f"the {part} matrix is not symmetric")
        found[part] = 0.5 * (found[part] + found[part].T)
    if "interface" in found:
        found["interface"] = np.ascontiguousarray(found["interface"].T)
    return MatrixSet(**found, labels=labels)


def _checked(path: Path, part: str, matrix: Array) -> Array:
    """A matrix of finite float64 numbers."""
    array = np.asarray(matrix)
    if array.ndim != 2 or array.dtype.kind not in "fiu" or array.size == 0:
        found = f"shape {array.shape} and type {array.dtype}"
        raise refuse(path, f"the {part} matrix has {found}: must be a matrix of real numbers")
    if not np.all(np.isfinite(array)):
        raise refuse(path, f"the {part} matrix has entries that are not finite")
    return np.asarray(array, dtype=np.float64)
