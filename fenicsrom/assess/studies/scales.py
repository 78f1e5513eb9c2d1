"""The scales to which the values of a scene are compared, from its reduced model."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg

from fenicsrom.arrays import Array
from fenicsrom.online.model.model import ReducedModel
from fenicsrom.online.model.polynomial import elastic_force
from fenicsrom.scene import Scene

# a smaller inverse buckling factor, relative to the largest, is rounding
LEAST_INVERSE_FACTOR = 1e-9


@dataclass(frozen=True)
class Scales:
    """The scales of a scene, in its units.

    Attributes:
        normal_stiffness: for each contact, the `normal_stiffness` at which the contact is as stiff
            as the body under it.
        tangential_stiffness: for each contact, the `tangential_stiffness` at which the contact is
            as stiff as the body in its most flexible tangential direction.
        preload: for each contact, the `preload` that buckles the body; None if nothing presses on
            the body, or if no preload buckles it.
        omega: first natural frequency of the reduced model about its equilibrium, rad/s.
    """

    normal_stiffness: tuple[float, ...]
    tangential_stiffness: tuple[float, ...]
    preload: tuple[float, ...] | None
    omega: float


def scales_of(model: ReducedModel, scene: Scene) -> Scales:
    """Compute the scales of a scene from its reduced model."""
    stiffness = [_body_stiffness(model, k) for k in range(len(scene.contacts))]
    squares = scipy.linalg.eigh(_symmetric_stiffness(model), model.mass, eigvals_only=True)
    return Scales(
        tuple(normal for normal, _ in stiffness),
        tuple(tangential for _, tangential in stiffness),
        buckling_preload(model, scene),
        float(np.sqrt(max(squares[0], 0.0))),
    )


def _symmetric_stiffness(model: ReducedModel) -> Array:
    """The symmetric part (n, n) of the tangent at q = 0; all of it without follower pressures."""
    stiffness = model.rest_stiffness()
    return np.asarray(0.5 * (stiffness + stiffness.T)) if model.pressure.numbers.size else stiffness


def _body_stiffness(model: ReducedModel, contact: int) -> tuple[float, float]:
    """Stiffness of the body at a contact along the normal and the softest tangent.

    With the flexibility C = B^T K^-1 B at the contact points and a unit force spread by their
    tributary areas a_p, f_p = a_p / sum a, the body has the stiffness 1 / (f^T C f). Springs of
    stiffness k per tributary area together have the stiffness k sum a.
    """
    areas = np.where(model.points.contact == contact, model.points.tributary_area, 0.0)
    dimension = model.points.position.shape[1]
    flexibility = []
    for direction in range(dimension):
        force = np.zeros((areas.size, dimension))
        force[:, direction] = areas / areas.sum()
        load = model.contact_rows.T @ force.reshape(-1)
        flexibility.append(float(load @ np.linalg.solve(model.rest_stiffness(), load)))
    softest = flexibility[0], max(flexibility[1:])
    normal, tangential = (float(1.0 / (c * areas.sum())) for c in softest)
    return normal, tangential


def buckling_preload(model: ReducedModel, scene: Scene) -> tuple[float, ...] | None:
    """The preload of each contact that buckles the body, or None.

    Linear buckling: the preload N displaces the body by q1 = -K^-1 B^T N. This changes the tangent
    by K_g = A q1. The buckling factor is the least positive factor with det(K + factor K_g) = 0.
    The contact springs and the curvature of the surface are left out.

    Args:
        model: the reduced model.
        scene: its scene. One factor scales all its preloads. If it has neither preloads nor gaps,
            all contacts get equal preloads.
    """
    pattern = np.array([contact.preload for contact in scene.contacts])
    if not pattern.any() and not any(contact.gap > 0.0 for contact in scene.contacts):
        pattern = np.ones(len(scene.contacts))
    if model.linear or not pattern.any():
        return None
    force = np.zeros((model.points.contact.size, scene.geometry.dimension))
    force[:, 0] = pattern[model.points.contact] * model.points.tributary_area
    stiffness = _symmetric_stiffness(model)
    q: Array = np.asarray(
        -np.linalg.solve(stiffness, model.contact_rows.T @ force.reshape(-1)), dtype=np.float64
    )
    # the tangent is a polynomial of second degree: this difference is exact
    geometric = 0.5 * (_tangent(model, q) - _tangent(model, -q))
    inverse_factors = scipy.linalg.eigh(-geometric, stiffness, eigvals_only=True)
    largest = float(inverse_factors[-1])
    if not largest > LEAST_INVERSE_FACTOR * float(np.max(np.abs(inverse_factors))):
        return None
    return tuple(float(preload) / largest for preload in pattern)


def _tangent(model: Any, q: Array) -> Array:
    """The tangent stiffness (n, n) at q (n,)."""
    force, tangent = np.empty_like(q), np.empty((q.size, q.size))
    elastic_force(model.elastic, np.ascontiguousarray(q), force, tangent)
    return tangent
