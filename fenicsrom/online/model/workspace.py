"""Scratch arrays of a reduced model."""

from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.online.contact.problem import Compliance


class Workspace(NamedTuple):
    """The results of a `ReducedModel` of n coordinates and m contact displacements.

    The results are valid until the next call of the model. In models of this size a new array costs
    compiled code more than the arithmetic on it.

    Attributes:
        columns: (n, p) the columns of the quadratic coefficients; they are combined faster than the
            rows.
        points: (2, n) coordinates.
        products: (3, 2, p) see `elastic_products`.
        force: (n,) elastic force.
        tangent: (n, n) its derivative.
        factor: (n, n) factors of the last effective stiffness.
        pivots: (n,)
        key: (3,) mass, velocity and tangent coefficient of the factor, by which a linear model
            keeps it; the first is NaN if the matrix is singular.
        compliance: the response to contact forces; its array `unit` holds right-hand sides and
            solutions.
        contact_columns: (n, m) the columns of the contact rows.
        contact: (m,) contact displacement.
        mass_product: (n,) M v.
        velocity_product: (n,) D v.
        factors: (loads,) time factors of the loads.
        load_vector: (n,) load vector, N.
        pressure_factors: (2, k) factors of the follower pressures at the start and at the end of
            the step.
        pressure_vectors: (2, n) coordinates and a force of a follower pressure.
        pressure_tangent: (n, n) its derivative.
        speeds: (3,) a varying speed at both ends of the step, and the length of the step.
        velocity: (n, n) D with the Coriolis force of the mean speed of the step.
    """

    columns: Array
    points: Annotated[Array, "2 n"]
    products: Annotated[Array, "3 2 p"]
    force: Annotated[Array, "n"]
    tangent: Annotated[Array, "n n"]
    factor: Annotated[Array, "n n"]
    pivots: Annotated[NDArray[np.int64], "n"]
    key: Annotated[Array, "3"]
    compliance: Compliance
    contact_columns: Array
    contact: Annotated[Array, "m"]
    mass_product: Annotated[Array, "n"]
    velocity_product: Annotated[Array, "n"]
    factors: Annotated[Array, "loads"]
    load_vector: Annotated[Array, "n"]
    pressure_factors: Annotated[Array, "2 k"]
    pressure_vectors: Annotated[Array, "2 n"]
    pressure_tangent: Annotated[Array, "pressed pressed"]
    speeds: Annotated[Array, "3"]
    velocity: Annotated[Array, "D D"]
