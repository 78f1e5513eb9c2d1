"""The size of a model for response curves: one for all of them, by the checks of their points.

The checks (`fenicsrom.assess.curves.trust`) compare the largest amplitude, the ends of each part
and points between them with the motions of all coordinates that the model holds. Where the worst of
these errors is above `basis.accuracy`, coordinates join the model by their energies in these
motions, as for one motion (`fenicsrom.assess.errors.sizing`), and the curves are followed again.
"""

from __future__ import annotations

import numpy as np

from fenicsrom.assess.curves.response_problem import family_of
from fenicsrom.assess.curves.response_results import Response
from fenicsrom.assess.curves.trust import Check, Richer, change, richer_motion
from fenicsrom.assess.errors.estimates import BASIS_SAFETY
from fenicsrom.assess.errors.sizing import candidate_energies, growing, unreached
from fenicsrom.online.curves.curve import CurvePoint
from fenicsrom.online.periodic.periodic_record import motion_of
from fenicsrom.online.periodic.shooting import PeriodicMotion
from fenicsrom.online.store.archive import StoredModel

POINTS = 3
"""The worst points of a curve that choose its size."""


def worst_checks(found: Response, stored: StoredModel) -> list[tuple[StoredModel, Check]]:
    """The points of each curve with errors above the accuracy, each with the model of its curve."""
    accuracy, families = stored.scene.basis.accuracy, found.table.families
    worst = []
    for curve in found.curves:
        wrong = [each for each in curve.checks if _error(each) > accuracy]
        wrong.sort(key=_error, reverse=True)
        own = stored
        if families is not None and wrong:
            own = stored.with_values({families.key: curve.value})
        worst += [(own, each) for each in wrong[:POINTS]]
    return worst


def _error(check: Check) -> float:
    """The estimated error of an amplitude due to the basis; zero where it is not known."""
    return BASIS_SAFETY * (check.basis_error or 0.0) if check.quantity == "amplitude" else 0.0


def larger_model(found: Response, stored: StoredModel, spare: int) -> StoredModel | None:
    """A model with the coordinates that the curves lack; None if they lack none, or none is left.

    Where the accuracy is not reached, a warning joins those of the curves.

    Args:
        found: the curves of the model, with their checks.
        stored: the model.
        spare: number of coordinates that must stay out, to judge the others.
    """
    worst = worst_checks(found, stored)
    basis = stored.scene.basis
    if not worst or not basis.adapts or basis.size is not None:
        return None
    points = []
    energies: dict[str, float] = {}
    for own, check in worst:
        whole = _motion(own, (*own.labels, *own.further), check.point)
        if whole is None:
            continue
        points.append((own, check.point, whole))
        for label, size in candidate_energies(own, motion_of(whole.record, whole.period)).items():
            energies[label] = max(size, energies.get(label, 0.0))
    labels = sorted(energies, key=lambda label: -energies[label])[: len(energies) - spare]
    best = None
    for chosen in growing(labels):
        best = (*stored.labels, *chosen)
        errors = [
            np.inf if near is None else BASIS_SAFETY * change(near.amplitude, whole.amplitude)
            for own, point, whole in points
            for near in [_motion(own, best, point)]
        ]
        if max(errors) <= stored.scene.basis.accuracy:
            break
    if best is not None:
        return stored.resized(best)
    error = max(_error(check) for _, check in worst)
    found.warnings.append(unreached(stored, error, stored.scene.basis.accuracy))
    return None


def _motion(
    stored: StoredModel, labels: tuple[str, ...], point: CurvePoint
) -> PeriodicMotion | None:
    """The motion of a model with more coordinates at a point of the curve of a model."""
    richer = Richer(family_of(stored.resized(labels)), np.eye(len(labels), stored.size))
    return richer_motion(point, richer)
