"""How far a response curve can be trusted: a finer time step and a richer basis at selected points.

The points are that of the largest amplitude, the folds, and both ends of each part of the curve. At
an ordinary point the other motion has the same parameter, and its amplitude is compared. A fold
moves instead: the other motion is sought normal to the tangent of the curve, and the parameters are
compared.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.assess.branches import Piece
from fenicsrom.errors import ConvergenceError
from fenicsrom.online.archive import StoredModel
from fenicsrom.online.continuation import Continuation
from fenicsrom.online.curve import CurvePoint, replaced
from fenicsrom.online.families import Family
from fenicsrom.online.periodic import FALLBACK_STEPS, Shooting, periodic_motion

LARGEST = "largest amplitude"
TOLERANCE = 1e-8  # of the residual of a motion of a richer basis


@dataclass(frozen=True, eq=False)
class Check:
    """A point of a curve at which its errors were estimated.

    Attributes:
        point: the point.
        where: "largest amplitude", "fold", "first" or "last".
        quantity: "amplitude", or "parameter" of a fold: what the errors are relative to.
        step_error: relative change with half the time step; None if that motion was not found.
        basis_error: relative change with a richer basis; None if there is none, or if its motion
            was not found.
    """

    point: CurvePoint
    where: str
    quantity: str
    step_error: float | None
    basis_error: float | None = None


@dataclass(frozen=True, eq=False)
class RicherModel:
    """A model with a richer basis, and how its coordinates follow from those of the model.

    Attributes:
        stored: the model under the scene.
        transfer: (n', n) its coordinates of the displacement that the model's coordinates describe.
    """

    stored: StoredModel
    transfer: Array


@dataclass(frozen=True, eq=False)
class Richer:
    """The periodic problems of a model with a richer basis.

    Attributes:
        family: its periodic problems by the parameter.
        transfer: as in `RicherModel`.
    """

    family: Family
    transfer: Array


def selected(pieces: Sequence[Piece]) -> list[tuple[str, CurvePoint]]:
    """The points of a curve at which its errors are estimated, each with its name."""
    points = [point for piece in pieces for point in piece.points]
    if not points:
        return []
    found = [(LARGEST, max(points, key=lambda point: float(point.amplitude.max())))]
    for piece in pieces:
        found += [("fold", point) for point in piece.special if point.kind == "fold"]
        found += [("first", piece.points[0]), ("last", piece.points[-1])]
    unique: dict[int, tuple[str, CurvePoint]] = {}
    for name, point in found:
        unique.setdefault(id(point), (name, point))
    return list(unique.values())


def checks(
    pieces: Sequence[Piece], family: Family, settings: Any, richer: Richer | None = None
) -> list[Check]:
    """Estimate the errors of a curve at selected points.

    Args:
        pieces: the parts of the curve.
        family: its problems by the parameter.
        settings: scheme, spectral radius and steps per period: a `fenicsrom.scene.Time`.
        richer: a model with a richer basis, if there is one.
    """
    found = []
    for where, point in selected(pieces):
        quantity = "parameter" if where == "fold" else "amplitude"
        other = _finer(point, family, settings, fold=where == "fold")
        error = None if other is None else _distance(point, other, quantity)
        basis = None if richer is None else _basis_error(point, richer, settings)
        found.append(Check(point, where, quantity, error, None if where == "fold" else basis))
    return found


def _distance(point: CurvePoint, other: CurvePoint, quantity: str) -> float:
    """Relative change of a quantity from a point to another."""
    if quantity == "parameter":
        return abs(other.parameter - point.parameter) / (abs(point.parameter) or 1.0)
    return _change(point.amplitude, other.amplitude)


def _change(amplitude: Array, other: Array) -> float:
    """Relative change of amplitudes."""
    size = float(np.max(amplitude))
    return float(np.max(np.abs(other - amplitude))) / size if size > 0.0 else 0.0


def _finer(point: CurvePoint, family: Family, settings: Any, *, fold: bool) -> CurvePoint | None:
    """The motion with half the time step at a point of a curve; None if it was not found."""
    steps = settings.steps_per_period or FALLBACK_STEPS
    problem = family(point.parameter)
    shooting = Shooting(
        problem.model,
        problem.contacts,
        settings.changed(steps_per_period=2 * steps),
        problem.period,
        point.periods,
    )
    s = shooting.scaled(point.z)
    range_ = abs(point.parameter) or 1.0
    path = Continuation(shooting, family, 0.0, range_, float(np.linalg.norm(s)) or 1.0)
    if not fold:
        return path.at_parameter(s, point.parameter)
    here = replaced(point, s=s)
    found = path.monodromy(here)
    if found is None:
        return None
    values, vectors = np.linalg.eig(found)
    along = np.append(np.real(vectors[:, int(np.argmin(np.abs(values - 1.0)))]), 0.0)
    return path.correct(path.place(here), along / np.linalg.norm(along))


def _basis_error(point: CurvePoint, richer: Richer, settings: Any) -> float | None:
    """Relative change of the amplitude of a point with a richer basis; None if it was not found."""
    problem = richer.family(point.parameter)
    n = richer.transfer.shape[1]
    model, contacts = problem.model, problem.contacts
    shooting = Shooting(model, contacts, settings, problem.period, point.periods)
    blocks = shooting.map.blocks
    moved = (point.z[: blocks * n].reshape(blocks, n) @ richer.transfer.T).ravel()
    start = np.concatenate([moved, point.z[blocks * n :]])
    try:
        motion = periodic_motion(
            model, contacts, settings, problem.period, start, point.periods, tolerance=TOLERANCE
        )
    except ConvergenceError:
        return None
    return _change(point.amplitude, motion.amplitude)


def richer_model(stored: StoredModel) -> RicherModel | None:
    """The model with all candidates (`fenicsrom.reduction.candidates`); None if it was not made.

    Args:
        stored: the reduced model.
    """
    candidates = stored.candidates
    if candidates is None:
        return None
    more = tuple(f"{k + 1}W" for k in range(candidates.size - stored.size))
    other = replace(stored, model=candidates, labels=(*stored.labels, *more), candidates=None)
    return RicherModel(other, np.eye(candidates.size, stored.size))
