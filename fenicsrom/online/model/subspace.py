"""Models on a subspace of a larger model, about another state: without a mesh, to rounding.

With q = q₀ + Z y, the coefficients of a cubic force are those of

    Zᵀ f(q₀ + Z y),    Kᵢⱼ → K + A q₀ + ½ B q₀ q₀,    Aᵢⱼₖ → A + B q₀,    B → B,    (1)

multiplied by Z at every index. Both A and B are stored by pairs of indices, so that each product is
one of matrices.

A model of some of the coordinates of a larger one (`nested_model`) has parts of its arrays.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.online.model.loads import PressurePolynomial
from fenicsrom.online.model.model import ReducedModel, reduced_model
from fenicsrom.online.model.polynomial import ElasticPolynomial, elastic_force, pair_numbers, pairs
from fenicsrom.online.model.turning import Turning

COLUMNS = 256
"""Columns of paired coefficients that are multiplied at once."""


def shifted(elastic: ElasticPolynomial, q0: Array) -> ElasticPolynomial:
    """The polynomial (1) about q0 (n,), with Z = I."""
    n = q0.size
    force, tangent = np.empty(n), np.empty((n, n))
    elastic_force(elastic, q0, force, tangent)
    quadratic = elastic.quadratic
    if quadratic.size:
        first, second = pairs(n)
        rows = np.arange(first.size)
        by_q = np.zeros((first.size, n))  # the derivative of the pairs of q at q0
        by_q[rows, second] += q0[first]
        by_q[rows, first] += q0[second]
        quadratic = quadratic + elastic.cubic @ by_q
    return ElasticPolynomial(force, tangent, quadratic, elastic.cubic)


def change_of_tangent(elastic: ElasticPolynomial, x: Array) -> Array:
    """The derivative (n, n) of the tangent at q = 0 along x (n,)."""
    return np.asarray((elastic.quadratic @ x)[pair_numbers(x.size)])


def projected(elastic: ElasticPolynomial, z: Array) -> ElasticPolynomial:
    """The polynomial (1) at q0 = 0 on the columns of Z (n, k)."""
    force, stiffness = z.T @ elastic.force, z.T @ elastic.stiffness @ z
    if not elastic.quadratic.size:
        return ElasticPolynomial(force, stiffness, np.zeros((0, 0)), np.zeros((0, 0)))
    first, second = pairs(len(z))
    k, m = pairs(z.shape[1])
    quadratic = _times_pairs(z, elastic.quadratic @ z)
    cubic = _times_pairs(z, elastic.cubic)
    cubic *= np.where(first == second, 2.0, 1.0)  # the columns i = j are halved
    return ElasticPolynomial(
        force, stiffness, quadratic, _times_pairs(z, cubic.T).T * np.where(k == m, 0.5, 1.0)
    )


def _times_pairs(z: Array, block: Array) -> Array:
    """The sum over i and j of z_ik z_jm times the row of the pair i, j, for each pair k <= m.

    One index after the other takes fewer products than a matrix of all pairs.

    Args:
        z: (n, k).
        block: (p, r) of the p pairs of n indices.
    """
    index = pair_numbers(len(z))
    k, m = pairs(z.shape[1])
    found = np.empty((k.size, block.shape[1]))
    for start in range(0, block.shape[1], COLUMNS):
        part = block[:, start : start + COLUMNS][index]
        once = np.tensordot(z, part, axes=(0, 0))
        found[:, start : start + COLUMNS] = np.matmul(z.T, once)[k, m]
    return found


def subspace_model(
    whole: ReducedModel, elastic: ElasticPolynomial, q0: Array, z: Array, velocity_matrix: Array
) -> ReducedModel:
    """The Galerkin projection of a model on q = q0 + Z y.

    Args:
        whole: the model, without follower pressures.
        elastic: its elastic force about q0 (`shifted`), on Z.
        q0: (n,) the state at y = 0.
        z: (n, k) Z.
        velocity_matrix: (n, n) D, or (0, 0).
    """
    return reduced_model(
        mass=z.T @ whole.mass @ z,
        damping=whole.damping,
        elastic=elastic,
        loads=z.T @ whole.loads,
        load_histories=whole.load_histories,
        points=whole.points,
        contact_rows=whole.contact_rows @ z,
        contact_offset=whole.contact_offset + whole.contact_rows @ q0,
        probe=whole.probe @ z,
        probe_offset=whole.probe_offset + whole.probe @ q0,
        velocity_matrix=z.T @ velocity_matrix @ z if velocity_matrix.size else velocity_matrix,
        bolts=whole.bolts.moved(
            lambda rows: np.column_stack([rows[:, 0] + rows[:, 1:] @ q0, rows[:, 1:] @ z])
        ),
    )


def about(model: ReducedModel, q0: Array) -> ReducedModel:
    """A model without follower pressures in the same coordinates, measured from a state q0 (n,)."""
    kept = {name: value for name, value in model._asdict().items() if name != "work"}
    kept["elastic"] = shifted(model.elastic, q0)
    kept["contact_offset"] = model.contact_offset + model.contact_rows @ q0
    kept["probe_offset"] = model.probe_offset + model.probe @ q0
    kept["bolts"] = model.bolts.moved(
        lambda rows: np.column_stack([rows[:, 0] + rows[:, 1:] @ q0, rows[:, 1:]])
    )
    return reduced_model(**kept)


def nested_model(whole: ReducedModel, chosen: Sequence[int]) -> ReducedModel:
    """The Galerkin projection of a model on some of its coordinates.

    Args:
        whole: the model, of N coordinates.
        chosen: (n,) its coordinates, in the order of those of the result.
    """
    at = np.asarray(chosen, dtype=np.int64)
    square = np.ix_(at, at)
    elastic, pressure, velocity = whole.elastic, whole.pressure, whole.velocity_matrix
    quadratic, cubic = elastic.quadratic, elastic.cubic
    if cubic.size:
        first, second = pairs(at.size)
        rows = pair_numbers(whole.size)[at[first], at[second]]
        quadratic, cubic = quadratic[np.ix_(rows, at)], cubic[np.ix_(rows, rows)]
    bent = pressure.quadratic
    return reduced_model(
        mass=whole.mass[square],
        damping=whole.damping,
        elastic=ElasticPolynomial(elastic.force[at], elastic.stiffness[square], quadratic, cubic),
        loads=whole.loads[at],
        load_histories=whole.load_histories,
        points=whole.points,
        contact_rows=whole.contact_rows[:, at],
        contact_offset=whole.contact_offset,
        probe=whole.probe[:, at],
        probe_offset=whole.probe_offset,
        velocity_matrix=velocity[square] if velocity.size else velocity,
        pressure=PressurePolynomial(
            pressure.numbers,
            pressure.linear[:, at[:, None], at],
            bent[:, at if bent.shape[1] else []][:, :, at[:, None], at],
        ),
        turning=_nested_turning(whole.turning, at),
        bolts=whole.bolts.moved(lambda rows: rows[:, np.append(0, 1 + at)]),
    )


def _nested_turning(turning: Turning, at: NDArray[np.int64]) -> Turning:
    """The data of a varying speed in some coordinates (n,)."""
    if not turning.history.size:
        return turning
    return turning._replace(
        centrifugal=turning.centrifugal[at],
        softening=turning.softening[np.ix_(at, at)],
        coriolis=turning.coriolis[np.ix_(at, at)],
        euler=turning.euler[at],
        moments=turning.moments[:, np.concatenate([[0], 1 + at])],
        rest=turning.rest[:, np.concatenate([np.arange(3), 3 + at])],
    )
