"""Models of some of the coordinates of a larger model: parts of its arrays, without a mesh."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fenicsrom.online.model.model import ReducedModel, reduced_model
from fenicsrom.online.model.polynomial import ElasticPolynomial, pairs
from fenicsrom.online.model.pressure import PressurePolynomial
from fenicsrom.online.model.turning import Turning


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
        first, second = pairs(whole.size)
        index = np.zeros((whole.size, whole.size), dtype=np.int64)
        index[first, second] = index[second, first] = np.arange(first.size)
        first, second = pairs(at.size)
        rows = index[at[first], at[second]]
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
