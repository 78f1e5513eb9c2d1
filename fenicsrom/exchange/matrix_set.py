"""The matrices of a linear superelement, as files of other programs name them.

MATLAB files (.mat) of a reduced model, and matrices in .mat and .npz files.

The MATLAB file holds the arrays of `fenicsrom.online.model.matrices` and the elastic force as a
polynomial: with the exponents e (t, n) and the coefficients c (n, t),

    f_i(q) = sum_t c_it prod_j q_j^e_tj.

The terms of the degrees 0 to 3 are those of force, stiffness, quadratic and cubic coefficients.
"""

from __future__ import annotations

import io
import math
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import combinations_with_replacement
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import scipy.sparse
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.errors import ErrorKind, refuse
from fenicsrom.files import atomic_write
from fenicsrom.formats.collector import content_of
from fenicsrom.online.contact.points import contacts_of
from fenicsrom.online.model.matrices import UNITS, ModelArrays
from fenicsrom.online.store.archive import StoredModel

CONTACT_NUMBERS = ("preload", "normal_stiffness", "tangential_stiffness", "friction")
LEFT_OUT = ("quadratic", "cubic")  # the polynomial holds them; B would take 8 n^4 bytes


def monomials(n: int, linear: bool) -> list[tuple[int, ...]]:
    """The products of coordinates of degree 0 to 1 or 3, as sorted tuples of their indices."""
    degrees = range(2 if linear else 4)
    return [term for k in degrees for term in combinations_with_replacement(range(n), k)]


def polynomial(arrays: ModelArrays, linear: bool) -> tuple[NDArray[np.int64], Array]:
    """The exponents (t, n) and coefficients (n, t) of the elastic force.

    Args:
        arrays: the arrays of the model.
        linear: whether the quadratic and cubic coefficients are zero.
    """
    n = arrays.force.size
    terms = monomials(n, linear)
    exponents = np.zeros((len(terms), n), dtype=np.int64)
    coefficients = np.empty((n, len(terms)))
    tensors = (arrays.force, arrays.stiffness, arrays.quadratic, arrays.cubic)
    for t, term in enumerate(terms):
        powers = Counter(term)
        for k, power in powers.items():
            exponents[t, k] = power
        # a symmetric tensor of degree m has the factor 1/m!, and each term m!/prod(powers!) times
        weight = 1.0 / math.prod(math.factorial(power) for power in powers.values())
        coefficients[:, t] = weight * np.moveaxis(tensors[len(term)], 0, -1)[term]
    return exponents, coefficients


def write_mat(path: Path, stored: StoredModel, arrays: ModelArrays, interface: Array) -> None:
    """Write a reduced model to a MATLAB file.

    Args:
        path: the file.
        stored: the model.
        arrays: its arrays.
        interface: (r, n) rows of the interface displacements.

    Raises:
        OSError: the file cannot be written.
    """
    from scipy.io import savemat

    exponents, coefficients = polynomial(arrays, stored.model.linear)
    contacts = contacts_of(stored.scene, stored.model.points)
    points = stored.model.points
    content: dict[str, Any] = {
        "M": arrays.mass,
        "C": arrays.damping + arrays.gyroscopic,
        "K": arrays.stiffness,
        **{name: array for name, array in arrays.asdict().items() if name not in LEFT_OUT},
        "exponents": exponents.astype(np.float64),
        "coefficients": coefficients,
        "interface": interface.T,
        "contact_number": points.contact + 1.0,
        "contact_position": points.position,
        "contact_frame": points.frame,
        **{f"contact_{name}": getattr(contacts, name) for name in CONTACT_NUMBERS},
        "contact_gap": np.where(contacts.kind == 1, contacts.radius, np.nan),
        "frequencies_hz": stored.frequencies_hz,
        "labels": np.array(stored.labels, dtype=object),
        "title": stored.scene.title,
        "units": {**UNITS, "interface": "1", "coefficients": "N/m^degree"},
    }
    with atomic_write(path) as temporary:
        savemat(temporary, content, do_compression=True, oned_as="column")


def read_mat(path: Path) -> MatrixSet:
    """Read the matrices of a superelement from a MATLAB file of version 5 to 7.

    Raises:
        SceneError: the file cannot be read, or its matrices do not fit together.
    """
    from scipy.io import loadmat

    return _read(path, loadmat, "is not a MATLAB file of version 5 to 7 ({}); save it with -v7")


def read_npz(path: Path) -> MatrixSet:
    """Read the matrices of a superelement from an .npz file.

    Raises:
        SceneError: the file cannot be read, or its matrices do not fit together.
    """
    return _read(path, np.load, "is not an .npz file ({})")


def _read(path: Path, load: Callable[[BinaryIO], Mapping[str, Any]], reason: str) -> MatrixSet:
    """The real matrices among the variables of a file; `reason` says why it cannot be read."""
    raw = io.BytesIO(content_of(path))
    try:
        dense = {
            name: value.toarray() if scipy.sparse.issparse(value) else np.asarray(value)
            for name, value in load(raw).items()
        }
    except Exception as error:  # damaged bytes raise many kinds of errors in scipy and numpy
        raise refuse(path, reason.format(error)) from None
    real = {name: a for name, a in dense.items() if a.ndim == 2 and a.dtype.kind in "fiu"}
    return matrix_set(path, real)


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
