"""A reduced model as a Python module of pure functions that needs only numpy.

The functions index, add and multiply their arguments with constant arrays. Therefore they also take
arrays of jax, inside `jax.jit`, `jax.grad` and `jax.jacfwd`, and the module does not import jax.
The arrays are stored as the bytes of float64 numbers, which is exact and short.
"""

from __future__ import annotations

import base64
from pathlib import Path

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.exchange.arrays import monomials, polynomial
from fenicsrom.files import atomic_write
from fenicsrom.online.model.matrices import ModelArrays

WIDTH = 90  # characters in a line of encoded numbers

HEADER = '''"""{title}

A reduced model of {n} coordinates q in SI units, written by fenicsrom:

    M q'' + C q' + f(q) = L s - Bc^T F

with the sizes s ({loads},) of the loads (static ones included, which balance f at q = 0) and the
forces F ({contacts},) of the contact points on their surfaces, in the local frames [normal,
tangents]. The functions are pure and take arrays of numpy or jax. With jax, enable numbers of 64
bits: jax.config.update("jax_enable_x64", True).
"""

import base64

import numpy as np


def _array(text, *shape):
    """Decode an array of float64."""
    return np.frombuffer(base64.b64decode(text), "<f8").reshape(shape).copy()

'''

FUNCTIONS = '''
_MASS_INVERSE = np.linalg.inv(MASS)


def elastic_force(q):
    """The elastic force f (n,) at q (n,), in N."""
    force = FORCE + STIFFNESS @ q
    if QUADRATIC.size:
        pairs = q[PAIRS[:, 0]] * q[PAIRS[:, 1]]
        triples = q[TRIPLES[:, 0]] * q[TRIPLES[:, 1]] * q[TRIPLES[:, 2]]
        force = force + QUADRATIC @ pairs + CUBIC @ triples
    return force


def elastic_energy(q):
    """The elastic energy at q (n,), zero at q = 0, in J."""
    energy = FORCE @ q + 0.5 * (q @ (STIFFNESS @ q))
    if QUADRATIC.size:
        pairs = q[PAIRS[:, 0]] * q[PAIRS[:, 1]]
        triples = q[TRIPLES[:, 0]] * q[TRIPLES[:, 1]] * q[TRIPLES[:, 2]]
        energy = energy + q @ (QUADRATIC @ pairs) / 3.0 + q @ (CUBIC @ triples) / 4.0
    return energy


def contact_displacement(q):
    """The displacement of the contact points in their local frames at q (n,), in m."""
    return CONTACT_OFFSET + CONTACT_ROWS @ q


def probe_displacement(q):
    """The displacement of the probe in global axes at q (n,), in m."""
    return PROBE_OFFSET + PROBE_ROWS @ q


def acceleration(q, v, load_sizes, contact_force=None):
    """The acceleration q'' (n,) at coordinates q (n,) and velocities v (n,), in m/s^2."""
    force = LOADS @ load_sizes - DAMPING @ v - elastic_force(q)
    if contact_force is not None:
        force = force - CONTACT_ROWS.T @ contact_force
    return _MASS_INVERSE @ force
'''


def write_source(path: Path, title: str, arrays: ModelArrays, linear: bool) -> None:
    """Write a reduced model as a Python module.

    Args:
        path: the file.
        title: title of the model.
        arrays: its arrays.
        linear: whether the quadratic and cubic coefficients are zero.

    Raises:
        OSError: the file cannot be written.
    """
    n = arrays.force.size
    coefficients = polynomial(arrays, linear)[1]
    terms = monomials(n, linear)
    named: dict[str, Array] = {
        "MASS": arrays.mass,
        "DAMPING": arrays.damping + arrays.gyroscopic,
        "FORCE": arrays.force,
        "STIFFNESS": arrays.stiffness,
        "QUADRATIC": coefficients[:, [k for k, term in enumerate(terms) if len(term) == 2]],
        "CUBIC": coefficients[:, [k for k, term in enumerate(terms) if len(term) == 3]],
        "LOADS": arrays.loads,
        "CONTACT_ROWS": arrays.contact_rows,
        "CONTACT_OFFSET": arrays.contact_offset,
        "PROBE_ROWS": arrays.probe_rows,
        "PROBE_OFFSET": arrays.probe_offset,
    }
    words = "".join(c if c.isprintable() and c not in '"\\' else " " for c in title).strip()
    text = HEADER.format(
        title=words or "A reduced model.",
        n=n,
        loads=arrays.loads.shape[1],
        contacts=arrays.contact_offset.size,
    )
    text += "".join(_definition(name, array) for name, array in named.items())
    text += f"""
# the products of the columns of QUADRATIC and CUBIC, by the indices of their coordinates
PAIRS = np.array([(i, j) for i in range({n}) for j in range(i, {n})])
TRIPLES = np.array([(i, j, k) for i, j in PAIRS for k in range(j, {n})])
"""
    with atomic_write(path) as temporary:
        temporary.write_text(text + FUNCTIONS, encoding="utf-8")


def _definition(name: str, array: Array) -> str:
    """The definition of an array, in lines."""
    data = base64.b64encode(np.ascontiguousarray(array, dtype="<f8").tobytes()).decode()
    lines = [f'    "{data[k : k + WIDTH]}"' for k in range(0, len(data), WIDTH)] or ['    ""']
    shape = ", ".join(map(str, array.shape))
    return "\n".join([f"{name} = _array(", *lines]) + f",\n    {shape},\n)\n"
