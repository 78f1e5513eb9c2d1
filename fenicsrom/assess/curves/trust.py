"""How far a response curve can be trusted: a finer time step and a richer basis at selected points.

The points are that of the largest amplitude, the folds, and both ends of each part of the curve. At
an ordinary point the other motion has the same parameter, and its amplitude is compared. A fold
moves instead: the other motion is sought normal to the tangent of the curve, and the parameters are
compared.

A basis that lacks the modes that break a symmetry gives the right motion and the wrong stability,
and long steps may do so too. The verdicts of the richer basis and of half the step are therefore
compared, also at points that are spread over the stable and the unstable parts, and between them
where the multipliers of the richer basis come near the unit circle
(`fenicsrom.assess.curves.stability_search`). Without a richer basis, stable points far from the
unit circle are left out. The verdict is not compared next to a change of stability, which may move.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.assess.curves.branches import Piece
from fenicsrom.assess.curves.stability_search import EXTRA, NEAR, divide_gaps, lengths_along
from fenicsrom.assess.errors.verdicts import BASIS_ERROR, TIME_ERROR, in_percent
from fenicsrom.errors import ConvergenceError
from fenicsrom.online.curves.continuation import Continuation
from fenicsrom.online.curves.curve import CurvePoint
from fenicsrom.online.periodic.families import Family
from fenicsrom.online.periodic.shooting import (
    FALLBACK_STEPS,
    PeriodicMotion,
    Shooting,
    largest_multiplier,
    periodic_motion,
)
from fenicsrom.online.store.archive import StoredModel
from fenicsrom.scene import Scene
from fenicsrom.scene.reading.units import in_words
from fenicsrom.words import counted

LARGEST = "largest amplitude"
BETWEEN = "between"
NEAR_CHANGE = "near instability"
SPREAD = 24  # most points of a curve, evenly over its stable parts, besides those that are named
UNSTABLE = 12  # likewise over its unstable parts
SHARE = 6  # points of a curve for each of these: a richer motion costs as much as several points
SAME_PART = 0.05  # difference of amplitudes, in parts of the larger, within a part of a curve
TOLERANCE = 1e-8  # of the residual of a motion of a richer basis


@dataclass(frozen=True, eq=False)
class Check:
    """A point of a curve at which its errors were estimated.

    Attributes:
        point: the point.
        where: "largest amplitude", "fold", "first", "last", "between" of a spread point, or "near
            instability" of a point that `fenicsrom.assess.curves.stability_search` adds.
        quantity: the quantity to which the errors are relative: "amplitude", or "parameter" of a
            fold.
        step_error: relative change with half the time step; None if that motion was not found.
        basis_error: relative change with a richer basis; None if there is none, or if its motion
            was not found.
        compared: whether a motion of a richer basis was sought, as at all points but folds.
        richer_verdict: the stability of that motion, as `CurvePoint.verdict`; None if it was not
            found.
        judged: whether the two verdicts must agree: no change of stability is next to the point.
        richer_multiplier: size of the largest multiplier of the richer basis, NaN if not known.
        finer_verdict: the stability with half the time step, as `richer_verdict`.
        finer_multiplier: size of its largest multiplier, likewise.
    """

    point: CurvePoint
    where: str
    quantity: str
    step_error: float | None
    basis_error: float | None = None
    compared: bool = False
    richer_verdict: str | None = None
    judged: bool = True
    richer_multiplier: float = np.nan
    finer_verdict: str | None = None
    finer_multiplier: float = np.nan

    @property
    def unknown(self) -> bool:
        """Whether the motion of the richer basis was sought and not found."""
        return self.compared and self.richer_verdict is None

    @property
    def contradicted(self) -> bool:
        """Whether the richer basis finds the motion stable where the model does not, or inverse."""
        return self._other_than(self.richer_verdict)

    @property
    def contradicted_by_step(self) -> bool:
        """As `contradicted`, of half the time step."""
        return self._other_than(self.finer_verdict)

    def _other_than(self, verdict: str | None) -> bool:
        return self.judged and verdict is not None and self.point.stable != (verdict == "stable")


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

    def start(self, point: CurvePoint, shooting: Shooting) -> Array:
        """The variables z (N',) of the richer basis at a point of the model."""
        blocks, n = shooting.map.blocks, self.transfer.shape[1]
        moved = (point.z[: blocks * n].reshape(blocks, n) @ self.transfer.T).ravel()
        return np.concatenate([moved, point.z[blocks * n :]])


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


def spread(pieces: Sequence[Piece], *, stable: bool = True) -> list[tuple[str, CurvePoint]]:
    """Up to `SPREAD` stable points, at equal distances along the stable parts.

    Without `stable` these are up to `UNSTABLE` unstable points. Of each kind there is at most one
    for `SHARE` points of the curve.
    """
    share = -(-sum(len(piece.points) for piece in pieces) // SHARE)
    count = min(SPREAD if stable else UNSTABLE, share)
    chosen, lengths = [], []
    for piece, along in zip(pieces, lengths_along(pieces), strict=True):
        for (before, point), length in zip(pairwise(piece.points), np.diff(along), strict=True):
            if before.stable == point.stable == stable:
                chosen.append(point)
                lengths.append(float(length))
    if not chosen:
        return []
    reached = np.cumsum(lengths)
    wanted = reached[-1] * (np.arange(count) + 0.5) / count
    at = np.minimum(np.searchsorted(reached, wanted), len(chosen) - 1)
    return [(BETWEEN, chosen[k]) for k in np.unique(at)]


def _next_to_change(pieces: Sequence[Piece]) -> set[int]:
    """The identities of the points with a neighbour of the other stability."""
    return {
        id(point)
        for piece in pieces
        for pair in pairwise(piece.points)
        if pair[0].stable != pair[1].stable
        for point in pair
    }


def checks(
    pieces: Sequence[Piece],
    family: Family,
    richer: Richer | None = None,
    ask: Callable[[], None] = lambda: None,
    limit: float = np.inf,
) -> list[Check]:
    """Estimate the errors of a curve at selected points.

    Args:
        pieces: the parts of the curve.
        family: its problems by the parameter.
        richer: a model with a richer basis, if there is one.
        ask: called before each point; it may raise KeyboardInterrupt.
        limit: change by a richer basis at the named points above which no other point is compared,
            because the curve will be followed again with more coordinates.
    """
    found: list[Check] = []
    changing = _next_to_change(pieces)

    def compare(where: str, point: CurvePoint) -> float:
        """Add the check of a point; give the size of the largest multiplier of the richer basis."""
        ask()
        judged = id(point) not in changing
        found.append(_check(where, point, family, richer, judged))
        return found[-1].richer_multiplier

    sizes = {id(point): compare(where, point) for where, point in selected(pieces)}
    if any((check.basis_error or 0.0) > limit for check in found):
        return found
    for name, point in [*spread(pieces), *spread(pieces, stable=False)]:
        near = not point.stable or _size(point) > 1.0 - NEAR
        if id(point) not in sizes and (near or richer is not None):
            sizes[id(point)] = compare(name, point)
    if richer is not None:
        divide_gaps(
            pieces,
            sizes,
            lambda a, b: _between(a, b, family),
            lambda point: compare(NEAR_CHANGE, point),
            min(EXTRA, len(sizes) // 2),
        )
    return found


def _check(
    where: str,
    point: CurvePoint,
    family: Family,
    richer: Richer | None,
    judged: bool,
) -> Check:
    """The check of one point; arguments as `checks` and `Check`."""
    quantity = "parameter" if where == "fold" else "amplitude"
    other = _finer(point, family, fold=where == "fold")
    error = None if other is None else _distance(point, other, quantity)
    check = Check(point, where, quantity, error, judged=judged)
    if where == "fold":
        return check
    if other is not None:
        check = replace(check, finer_verdict=other.verdict, finer_multiplier=_size(other))
    if richer is None:
        return check
    motion = richer_motion(point, richer)
    if motion is None:
        return replace(check, compared=True)
    return replace(
        check,
        compared=True,
        basis_error=change(point.amplitude, motion.amplitude),
        richer_verdict=motion.verdict,
        richer_multiplier=_size(motion),
    )


def _size(motion: CurvePoint | PeriodicMotion) -> float:
    """Size of the largest multiplier that decides on the stability."""
    return abs(largest_multiplier(motion.multipliers, motion.free_sliders))


def _between(a: CurvePoint, b: CurvePoint, family: Family) -> CurvePoint | None:
    """The stable motion at the mean parameter of two neighbours; None if it was not found.

    A motion whose amplitudes are not near those of the neighbours belongs to another part.
    """
    parameter = 0.5 * (a.parameter + b.parameter)
    if parameter in (a.parameter, b.parameter) or a.periods != b.periods:
        return None
    shooting, path = _path(a, family)
    s = 0.5 * (shooting.scaled(a.z) + shooting.scaled(b.z))
    found = path.at_parameter(s, parameter)
    if found is None or not found.stable:
        return None
    apart = np.abs(found.amplitude - 0.5 * (a.amplitude + b.amplitude)).max()
    near = np.abs(a.amplitude - b.amplitude).max() + SAME_PART * np.abs(a.amplitude).max()
    return found if apart <= near else None


def _distance(point: CurvePoint, other: CurvePoint, quantity: str) -> float:
    """Relative change of a quantity from a point to another."""
    if quantity == "parameter":
        return abs(other.parameter - point.parameter) / (abs(point.parameter) or 1.0)
    return change(point.amplitude, other.amplitude)


def change(amplitude: Array, other: Array) -> float:
    """Relative change of amplitudes."""
    size = float(np.max(amplitude))
    return float(np.max(np.abs(other - amplitude))) / size if size > 0.0 else 0.0


def _finer(point: CurvePoint, family: Family, *, fold: bool) -> CurvePoint | None:
    """The motion with half the time step at a point of a curve; None if it was not found."""
    shooting, path = _path(point, family, 2)
    s = shooting.scaled(point.z)
    if not fold:
        return path.at_parameter(s, point.parameter)
    here = replace(point, s=s)
    found = path.monodromy(here)
    if found is None:
        return None
    values, vectors = np.linalg.eig(found)
    along = np.append(np.real(vectors[:, int(np.argmin(np.abs(values - 1.0)))]), 0.0)
    return path.correct(path.place(here), path.direction(replace(here, tangent=along)))


def _path(point: CurvePoint, family: Family, finer: int = 1) -> tuple[Shooting, Continuation]:
    """The path that finds motions near a point, with so many times the steps per period."""
    problem = family(point.parameter)
    steps = finer * (problem.time.steps_per_period or FALLBACK_STEPS)
    time = problem.time.changed(steps_per_period=steps)
    shooting = Shooting(problem._replace(time=time), point.periods)
    bounds = 0.0, abs(point.parameter) or 1.0
    return shooting, Continuation(shooting, family, *bounds, shooting.scaled(point.z))


def richer_motion(point: CurvePoint, richer: Richer) -> PeriodicMotion | None:
    """The motion of a richer basis at a point, stable or not; None if it was not found."""
    problem = richer.family(point.parameter)
    start = richer.start(point, Shooting(problem, point.periods))
    try:
        return periodic_motion(problem, start, point.periods, tolerance=TOLERANCE)
    except ConvergenceError:
        return None


def contradictions(curve_checks: Sequence[Check], scene: Scene, parameter: str) -> list[str]:
    """Sentences on the points whose stability half the step or a richer basis judges otherwise.

    Args:
        curve_checks: checks of a curve.
        scene: the scene, for units.
        parameter: name of the parameter of the curve.
    """
    by_step = [
        (check, check.finer_verdict, check.finer_multiplier, check.contradicted_by_step)
        for check in curve_checks
    ]
    by_basis = [
        (check, check.richer_verdict, check.richer_multiplier, check.contradicted)
        for check in curve_checks
    ]
    said = []
    for who, compared, advice in (
        ("half the time step", by_step, "increase time.steps_per_period."),
        (
            "a richer basis",
            by_basis,
            'lower basis.threshold, set basis.derivatives = "all", or raise basis.modes.',
        ),
    ):
        groups: dict[tuple[str, str], list[tuple[Check, float]]] = {}
        for check, verdict, size, contradicted in compared:
            if contradicted:
                groups.setdefault((verdict or "", check.point.verdict), []).append((check, size))
        if not groups:
            continue
        listed = "; ".join(
            f"{_in_words(other)} instead of {_in_words(own)} at {_place(group, scene, parameter)} "
            f"(multipliers up to {_outside(other, group):.2g} outside of the unit circle)"
            for (other, own), group in groups.items()
        )
        found = sum(len(group) for group in groups.values())
        known = sum(verdict is not None for _, verdict, _, _ in compared)
        said.append(
            f"{who} finds another stability of {found} of {counted(known, 'compared motion')}: "
            f"{listed}; {advice}"
        )
    return said


def inaccuracies(curve_checks: Sequence[Check], scene: Scene, parameter: str) -> list[str]:
    """Sentences on the largest changes by half the time step and by a richer basis.

    The sentences name changes that are larger than the error that a run accepts.

    Args:
        curve_checks: checks of a curve.
        scene: the scene, for units.
        parameter: name of the parameter of the curve.
    """
    said = []
    for name, what, limit, advice in (
        ("step_error", "half the time step", TIME_ERROR, "increase time.steps_per_period"),
        (
            "basis_error",
            "a richer basis",
            BASIS_ERROR,
            "lower basis.threshold or raise basis.modes",
        ),
    ):
        sizes = [getattr(check, name) or 0.0 for check in curve_checks]
        worst = max(sizes, default=0.0)
        if worst > limit:
            check = curve_checks[sizes.index(worst)]
            changed = "amplitude" if check.quantity == "amplitude" else f"{parameter} of a fold"
            said.append(
                f"{what} changes the {changed} by {in_percent(worst)} at "
                f"{in_words(scene, parameter, check.point.parameter)} (a run accepts an error of "
                f"{in_percent(limit)}): {advice}."
            )
    return said


def _place(group: Sequence[tuple[Check, float]], scene: Scene, parameter: str) -> str:
    """Where some checks of a curve are: a value of the parameter, or a range."""
    values = [check.point.parameter for check, _ in group]
    if len(values) == 1:
        return in_words(scene, parameter, values[0])
    last = in_words(scene, parameter, max(values))
    return f"{len(values)} points from {parameter} = {min(values):.6g} to {last}"


def _outside(other: str, group: Sequence[tuple[Check, float]]) -> float:
    """How far outside of the unit circle a multiplier is, where the instability is found."""
    return max(_size(check.point) if other == "stable" else size for check, size in group) - 1.0


def _in_words(verdict: str) -> str:
    """The stability of a motion in words."""
    return verdict if verdict == "stable" else f"unstable ({verdict})"


def richer_model(stored: StoredModel) -> RicherModel | None:
    """The model with all candidates (`fenicsrom.reduction.candidates`); None if it was not made.

    Args:
        stored: the reduced model.
    """
    candidates = stored.candidates
    if candidates is None:
        return None
    other = stored.resized((*stored.labels, *stored.further))
    return RicherModel(other, np.eye(candidates.size, stored.size))
