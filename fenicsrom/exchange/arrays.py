"""MATLAB files (.mat) of a reduced model, and matrices in .mat and .npz files.

The MATLAB file holds the arrays of `fenicsrom.online.model.matrices` and the elastic force as a
polynomial: with the exponents e (t, n) and the coefficients c (n, t),

    f_i(q) = sum_t c_it prod_j q_j^e_tj.

The terms of the degrees 0 to 3 are those of force, stiffness, quadratic and cubic coefficients.
"""

import io
import math
from collections import Counter
from collections.abc import Callable, Mapping
from itertools import combinations_with_replacement
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import scipy.sparse
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.errors import refuse
from fenicsrom.exchange.matrix_set import MatrixSet, matrix_set
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
