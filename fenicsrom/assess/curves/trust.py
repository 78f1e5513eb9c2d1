"""How far a response curve can be trusted: a finer time step and a richer basis at selected points.

The points are that of the largest amplitude, both ends of each part of the curve, and bifurcations.
At an ordinary point the other motion has the same parameter, and its amplitude is compared. A
bifurcation moves instead, and its parameters are compared. At a fold the other motion is sought
normal to the tangent of the curve. Another change of stability moves by about

    (|mu'| - |mu|) / (1 - |mu|) times its distance from a point,                                (1)

where |mu| and |mu'| are the largest multipliers at this point and of the other motion there. The
point is the stable neighbour, with |mu'| of the bifurcation itself.

A basis that lacks the modes that break a symmetry gives the right motion and the wrong stability,
and long steps may do so too. The verdicts of the richer basis and of half the step are therefore
compared, also at points that are spread over the stable and the unstable parts, and between them
where the multipliers of the richer basis come near the unit circle
(`fenicsrom.assess.curves.stability_search`). Where the richer basis differs, its motion with half
the step must differ too. Without a richer basis, stable points far from the
unit circle are left out. The verdict is not judged next to a change of stability, nor where such a
change moves past the point by (1), by at most `MOVES`, and the verdict is the same elsewhere on the
same stretch, or the stretch goes on beyond the end of the curve.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.assess.curves.stability_search import EXTRA, NEAR, divide_gaps, lengths_along
from fenicsrom.assess.errors.estimates import BASIS_SAFETY
from fenicsrom.assess.errors.sizing import can_grow
from fenicsrom.errors import ConvergenceError
from fenicsrom.online.curves.continuation import Continuation
from fenicsrom.online.curves.curve import BIFURCATIONS, UNJUDGED, UNSURE, CurvePoint, Piece
from fenicsrom.online.periodic.shooting import (
    FALLBACK_STEPS,
    Family,
    PeriodicMotion,
    Shooting,
    largest_multiplier,
    solve,
)
from fenicsrom.online.store.archive import StoredModel
from fenicsrom.online.store.disk import StoredDisk

LARGEST = "largest amplitude"
FOLD = "fold"
BETWEEN = "between"
NEAR_CHANGE = "near instability"
SPREAD = 24  # most points of a curve, evenly over its stable parts, besides those that are named
UNSTABLE = 12  # likewise over its unstable parts
SHARE = 6  # points of a curve for each of these: a richer motion costs as much as several points
MARCHES = 3  # with derivatives, for a motion near a known one
ITERATIONS = 15  # of Newton's method after which such a motion counts as not found
FIXED = 3e4  # a march takes a time of about FIXED + 4 n^4 + 3 n (N - 2 n) N
SHORT = 5e7  # some seconds, likewise
MOVES = 0.01  # of its parameter: the shift of a bifurcation that is no contradiction
FARTHEST = 0.1  # largest shift that (1) estimates, likewise
STEP = 1e-5  # of Newton's method, relative to the variables, after which such a motion is found
SAME_PART = 0.05  # difference of amplitudes, in parts of the larger, within a part of a curve
SAME_MOTION = 0.2  # largest change of an amplitude by a finer step; else it is another motion
TOLERANCE = 1e-8  # of the residual of a motion of a richer basis


Finer = Callable[[CurvePoint], CurvePoint | PeriodicMotion | None]


@dataclass(frozen=True, eq=False)
class Check:
    """A point of a curve at which its errors were estimated.

    Attributes:
        point: the point.
        where: "largest amplitude", "first", "last", the kind of a bifurcation, "between" of a
            spread point, or "near instability" of a point that
            `fenicsrom.assess.curves.stability_search` adds.
        quantity: the quantity to which the errors are relative: "amplitude", or "parameter" of a
            bifurcation.
        step_error: relative change with half the time step, or by more harmonics; None if that
            motion was not found.
        basis_error: relative change with a richer basis; None if there is none, or if its motion
            was not found.
        compared: whether a motion of a richer basis was sought, as at all points but folds.
        richer_verdict: the stability of that motion, as `CurvePoint.verdict`; `UNSURE` if it is not
            that of the point, and half the time step denies it; None if it was not found.
        judged: whether the two verdicts must agree: no change of stability is near.
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
        return self.contradicts(self.richer_verdict)

    @property
    def contradicted_by_step(self) -> bool:
        """As `contradicted`, of half the time step."""
        return self.contradicts(self.finer_verdict)

    def contradicts(self, verdict: str | None) -> bool:
        """Whether the verdict on another motion differs from that on the point."""
        known = self.judged and self.point.known and verdict not in (None, UNSURE, UNJUDGED)
        return known and self.point.stable != (verdict == "stable")


@dataclass(frozen=True, eq=False)
class RicherModel:
    """A model with a richer basis, and how its coordinates follow from those of the model.

    Attributes:
        stored: the model under the scene.
        transfer: (n', n) its coordinates of the displacement that the model's coordinates describe;
            (0, 0) of a disk, where they are not known.
        limit: change of an amplitude by the richer basis above which the curves will be followed
            again with more coordinates.
    """

    stored: StoredModel | StoredDisk
    transfer: Array
    limit: float = np.inf


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
        found += [("first", piece.points[0]), ("last", piece.points[-1])]
    names: dict[CurvePoint, str] = {}
    for name, point in found:
        names.setdefault(point, name)
    return [(name, point) for point, name in names.items()]


def spread(pieces: Sequence[Piece], *, stable: bool = True) -> list[tuple[str, CurvePoint]]:
    """Up to `SPREAD` stable points, at equal distances along the stable parts.

    Without `stable` these are up to `UNSTABLE` unstable points, single ones too. Of each kind there
    is at most one for `SHARE` points of the curve.
    """
    share = -(-sum(len(piece.points) for piece in pieces) // SHARE)
    count = min(SPREAD if stable else UNSTABLE, share)
    chosen, lengths = [], []
    for piece, along in zip(pieces, lengths_along(pieces), strict=True):
        ends = [*piece.points[2:], piece.points[-1]]
        pairs = zip(pairwise(piece.points), ends, np.diff(along), strict=True)
        for (before, point), after, length in pairs:
            single = not stable and before.stable and after.stable
            if point.stable == stable and (before.stable == stable or single):
                chosen.append(point)
                lengths.append(float(length))
    if not chosen:
        return []
    reached = np.cumsum(lengths)
    wanted = reached[-1] * (np.arange(count) + 0.5) / count
    at = np.minimum(np.searchsorted(reached, wanted), len(chosen) - 1)
    return [(BETWEEN, chosen[k]) for k in np.unique(at)]


class Bifurcation(NamedTuple):
    """A bifurcation of a curve: a fold, or another change of stability.

    Attributes:
        event: the bifurcation.
        ends: the points of the curve before and after it.
    """

    event: CurvePoint
    ends: tuple[CurvePoint, CurvePoint]

    def shift(self, other: CurvePoint | PeriodicMotion | None) -> float | None:
        """How far the bifurcation moves, relative to its parameter; None if it is not known.

        The estimate (1) is not known above `FARTHEST`.

        Args:
            other: the motion of a finer step or of a richer basis.
        """
        parameter = self.event.parameter
        if other is None:
            return None
        if self.event.kind == FOLD:
            assert isinstance(other, CurvePoint)
            return abs(other.parameter - parameter) / (abs(parameter) or 1.0)
        stable = min(self.ends, key=size_of)
        moved = abs((size_of(other) - 1.0) * (stable.parameter - parameter))
        left = (1.0 - size_of(stable)) * (abs(parameter) or 1.0)
        return moved / left if moved < FARTHEST * left else None


def bifurcations(pieces: Sequence[Piece]) -> list[Bifurcation]:
    """The folds and the changes of stability of a curve that were located, in order."""
    found = []
    for piece in pieces:
        rows = piece.in_order()
        at = [k for k, point in enumerate(rows) if not point.kind]
        for before, after in pairwise(at):
            ends = rows[before], rows[after]
            for event in rows[before + 1 : after]:
                turns = ends[0].stable != ends[1].stable and event.kind in BIFURCATIONS
                if turns or event.kind == FOLD:
                    found.append(Bifurcation(event, ends))
    return found


class _Checks:
    """The checks of a curve; arguments as `checks`."""

    def __init__(
        self,
        pieces: Sequence[Piece],
        family: Family,
        richer: Richer | None,
        ask: Callable[[], None],
        finer: Finer | None,
    ):
        self._pieces, self._family, self._richer, self._ask = pieces, family, richer, ask
        self._finer = finer or (lambda point: finer_motion(point, family))
        self._bifurcations = bifurcations(pieces)
        self._home: dict[CurvePoint, CurvePoint] = {}
        self._motions: dict[CurvePoint, PeriodicMotion | None] = {}  # of the richer basis
        self.found: list[Check] = []

    def bifurcations(self, most: int) -> None:
        """Check up to so many bifurcations, evenly chosen."""
        count = len(self._bifurcations)
        for k in np.unique(np.linspace(0, count - 1, min(most, count)).astype(int)):
            self._shift(self._bifurcations[k])

    def _shift(self, bifurcation: Bifurcation) -> int:
        """The number of the check of how far a bifurcation moves, which is made if need be."""
        event = bifurcation.event
        for k, check in enumerate(self.found):
            if check.point is event:
                return k
        self.compare(event.kind, event, richer=event.kind != FOLD, bifurcation=bifurcation)
        return len(self.found) - 1

    def compare(
        self,
        where: str,
        point: CurvePoint,
        *,
        richer: bool = True,
        step: bool = True,
        bifurcation: Bifurcation | None = None,
    ) -> Check:
        """Add the check of a point.

        Args:
            where: as in `Check`.
            point: the point.
            richer: whether to compare with the richer basis, if there is one.
            step: whether to compare with half the step.
            bifurcation: the one at this point, if any: its parameter is compared.
        """

        def error(other: CurvePoint | PeriodicMotion | None) -> float | None:
            if bifurcation is not None:
                return bifurcation.shift(other)
            return None if other is None else change(point.amplitude, other.amplitude)

        self._ask()
        finer, motion, verdict = self._finer(point) if step else None, None, None
        if self._richer is not None and richer:
            if point not in self._motions:
                self._motions[point] = richer_motion(point, self._richer)
            motion = self._motions[point]
            verdict = None if motion is None else _confirmed(point, motion, self._richer)
        check = Check(
            point,
            where,
            "amplitude" if bifurcation is None else "parameter",
            step_error=error(finer),
            basis_error=error(motion),
            compared=self._richer is not None and richer,
            richer_verdict=verdict,
            judged=bifurcation is None,
            richer_multiplier=size_of(motion),
            finer_verdict=None if finer is None else finer.verdict,
            finer_multiplier=size_of(finer),
        )
        self.found.append(check)
        return check

    def between(self, a: CurvePoint, b: CurvePoint) -> CurvePoint | None:
        """The stable motion at the mean parameter of two neighbours; None if it was not found."""
        found = _between(a, b, self._family)
        if found is not None:
            self._home[found] = a
        return found

    def judge(self) -> None:
        """Excuse the points whose stability changes by the shift of a bifurcation."""
        for check in self.found:  # it may grow
            if check.contradicted or check.contradicted_by_step:
                if self._is_shift(check):
                    self.found[self.found.index(check)] = replace(check, judged=False)

    def _is_shift(self, check: Check) -> bool:
        """Whether a contradiction comes from the shift of a bifurcation next to a point.

        The point lies in a stretch of one stability. A stretch that the other motions do not have
        at all is more than a shift, but one that the end of the curve cuts off may go on beyond it.
        """
        point, home = check.point, self._home.get(check.point, check.point)
        for piece in self._pieces:
            at = next((k for k, other in enumerate(piece.points) if other is home), None)
            if at is None:
                continue
            turns = [k for k, (a, b) in enumerate(pairwise(piece.points)) if a.stable != b.stable]
            first = max((k + 1 for k in turns if k < at), default=0)
            last = min((k for k in turns if k >= at), default=len(piece.points) - 1)
            stretch = piece.points[first : last + 1]
            next_to_it = point is home and (at in turns or at - 1 in turns)
            if next_to_it and self._has_agreement(stretch, check):
                return True
            for known in self._bifurcations:
                if known.ends[1] is stretch[0] or known.ends[0] is stretch[-1]:
                    cut = first == 0 or last == len(piece.points) - 1
                    if self._moves(known, check) and (cut or self._has_agreement(stretch, check)):
                        return True
        return False

    def _moves(self, known: Bifurcation, check: Check) -> bool:
        """Whether a bifurcation moves past a point by at most `MOVES`, as its check then says."""
        place, own = known.event.parameter, size_of(check.point)
        left = abs(1.0 - own) * (abs(place) or 1.0)
        shifts = {
            name: abs((other - own) * (check.point.parameter - place)) / left
            for name, other, differs in (
                ("step_error", check.finer_multiplier, check.contradicted_by_step),
                ("basis_error", check.richer_multiplier, check.contradicted),
            )
            if differs
        }
        if max(shifts.values()) > MOVES:
            return False
        k = self._shift(known)
        known_shifts: dict[str, Any] = {
            name: max(getattr(self.found[k], name) or 0.0, shift) for name, shift in shifts.items()
        }
        self.found[k] = replace(self.found[k], **known_shifts)
        return True

    def _has_agreement(self, stretch: Sequence[CurvePoint], check: Check) -> bool:
        """Whether the other motions have the stability of a stretch somewhere."""

        def agrees(other: Check) -> bool:
            asked = [other.finer_verdict] * check.contradicted_by_step
            asked += [other.richer_verdict] * check.contradicted
            return all(
                verdict not in (None, UNSURE) and other.point.stable == (verdict == "stable")
                for verdict in asked
            )

        known = [c for c in self.found if self._home.get(c.point, c.point) in stretch]
        clearest = max(stretch, key=lambda point: abs(size_of(point) - 1.0))
        if not any(map(agrees, known)) and all(c.point is not clearest for c in known):
            self.compare(BETWEEN, clearest, richer=check.contradicted)
            known.append(self.found[-1])
        return any(map(agrees, known))


def checks(
    pieces: Sequence[Piece],
    family: Family,
    richer: Richer | None = None,
    ask: Callable[[], None] = lambda: None,
    limit: float = np.inf,
    finer: Finer | None = None,
) -> list[Check]:
    """Estimate the errors of a curve at selected points.

    Args:
        pieces: the parts of the curve.
        family: its problems by the parameter.
        richer: a model with a richer basis, if there is one.
        ask: called before each point; it may raise KeyboardInterrupt.
        limit: as in `RicherModel`; where it is passed, the step of other points is not judged.
        finer: gives the motion with half the step at a point, if the caller knows some of them.
    """
    made = _Checks(pieces, family, richer, ask, finer)
    sizes = {
        point: made.compare(where, point).richer_multiplier for where, point in selected(pieces)
    }
    if any((check.basis_error or 0.0) > limit for check in made.found):
        return made.found
    count = sum(len(piece.points) for piece in pieces)
    made.bifurcations(min(SPREAD, -(-count // SHARE)))
    others = [each for each in spread(pieces) if each[1] not in sizes]
    others += [each for each in spread(pieces, stable=False) if each[1] not in sizes]
    left = _affordable(pieces, richer) - len(made.found)
    every = -(-len(others) // left) if left > 0 else len(others) + 1
    if np.isfinite(limit):
        named = len(made.found)
        judged = [made.compare(*each, step=False) for each in others[every - 1 :: every]]
        if any((check.basis_error or 0.0) > limit for check in judged):
            return made.found
        del made.found[named:]
    for k, (name, point) in enumerate(others, 1):
        both = k % every == 0
        if both or not point.stable or size_of(point) > 1.0 - NEAR:
            check = made.compare(name, point, richer=both)
            if both:
                sizes[point] = check.richer_multiplier
    if richer is not None:
        most = min(EXTRA, len(sizes) // 2, max(left - len(others), 0))
        divide_gaps(
            pieces,
            sizes,
            made.between,
            lambda point: made.compare(NEAR_CHANGE, point).richer_multiplier,
            most,
        )
    made.judge()
    return made.found


def _affordable(pieces: Sequence[Piece], richer: Richer | None) -> int:
    """Number of motions of the richer basis that take as long as the curve and some seconds."""
    points = [point for piece in pieces for point in [*piece.points, *piece.special]]
    if not points or richer is None:
        return 0
    sizes = richer.transfer.shape
    sliders = points[0].z.size - 2 * sizes[1]
    other, own = (march_cost(n, sliders) for n in sizes)
    spent = SHORT + own * sum(point.marches[1] for point in points)
    return int(spent / (MARCHES * other))


def march_cost(n: int, sliders: int) -> float:
    """Operations of a march with derivatives of n coordinates and N variables, in some unit.

    They evaluate the elastic force, 4 n^4, and the contact forces, 3 n (N - 2 n) N, where N - 2 n
    is the number of sliders.
    """
    return FIXED + 4.0 * n**4 + 3.0 * n * sliders * (sliders + 2 * n)


def size_of(motion: CurvePoint | PeriodicMotion | None) -> float:
    """Size of the largest multiplier that decides on the stability; NaN without a motion."""
    if motion is None:
        return np.nan
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


def change(amplitude: Array, other: Array) -> float:
    """Relative change of amplitudes."""
    size = float(np.max(amplitude))
    return float(np.max(np.abs(other - amplitude))) / size if size > 0.0 else 0.0


def finer_motion(
    point: CurvePoint, family: Family, finer: int = 2
) -> CurvePoint | PeriodicMotion | None:
    """The motion with `finer` times as many steps at a point of a curve; None if it was not found.

    Shorter steps may change how a high mode rings, which no single correction bridges: then
    bounded steps of Newton's method seek the motion. Next to a fold they may cross it, and what
    they find then is the motion of the other branch.
    """
    shooting, path = _path(point, family, finer)
    s = shooting.scaled(point.z)
    if point.kind != FOLD:
        near = path.at_parameter(s, point.parameter, exact=False)
        if near is not None:
            return near
        far = _solved(shooting, s)
        crosses = far is not None and (far.verdict == FOLD) != (point.verdict == FOLD)
        return None if crosses else far
    here = replace(point, s=s)
    found = path.monodromy(here)
    if found is None:
        return None
    values, vectors = np.linalg.eig(found)
    along = np.append(np.real(vectors[:, int(np.argmin(np.abs(values - 1.0)))]), 0.0)
    return path.correct(path.place(here), path.direction(replace(here, tangent=along)))


def _path(point: CurvePoint, family: Family, finer: int = 1) -> tuple[Shooting, Continuation]:
    """The path that finds motions near a point, with so many times the steps per period."""
    shooting = _shooting(point, family, finer)
    bounds = 0.0, abs(point.parameter) or 1.0
    return shooting, Continuation(shooting, family, *bounds, shooting.scaled(point.z))


def _shooting(point: CurvePoint, family: Family, finer: int) -> Shooting:
    """The equation of motions at the parameter of a point, with so many times the steps."""
    problem = family(point.parameter)
    steps = finer * (problem.time.steps_per_period or FALLBACK_STEPS)
    time = problem.time.changed(steps_per_period=steps)
    return Shooting(problem._replace(time=time), point.periods)


def richer_motion(point: CurvePoint, richer: Richer, finer: int = 1) -> PeriodicMotion | None:
    """The motion of a richer basis at a point, stable or not; None if it was not found.

    It has `finer` times as many steps as the motions of the curve.
    """
    shooting = _shooting(point, richer.family, finer)
    return _solved(shooting, shooting.scaled(richer.start(point, shooting)))


def _confirmed(point: CurvePoint, motion: PeriodicMotion, richer: Richer) -> str:
    """The verdict on a motion of a richer basis at a point; see `Check.richer_verdict`.

    Half the step is asked only where this verdict contradicts that of the point: the fast modes of
    a richer basis, which the step does not resolve, may ring.
    """
    if motion.stable == point.stable:
        return motion.verdict
    finer = richer_motion(point, richer, 2)
    same = finer is not None and change(motion.amplitude, finer.amplitude) <= SAME_MOTION
    return UNSURE if finer is not None and same and finer.stable == point.stable else motion.verdict


def _solved(shooting: Shooting, s: Array) -> PeriodicMotion | None:
    """The motion near scaled variables s (N,); None if it was not found."""
    try:
        return solve(shooting, s, TOLERANCE, step_tolerance=STEP, iterations=ITERATIONS)
    except ConvergenceError:
        return None


def richer_model(stored: StoredModel, spare: int) -> RicherModel | None:
    """The model with all candidates (`fenicsrom.reduction.candidates`); None if it was not made.

    Args:
        stored: the reduced model.
        spare: number of coordinates that must stay out, to judge the others.
    """
    candidates = stored.candidates
    if candidates is None:
        return None
    other = stored.resized((*stored.labels, *stored.further))
    limit = stored.scene.basis.accuracy / BASIS_SAFETY if can_grow(stored, spare) else np.inf
    return RicherModel(other, np.eye(candidates.size, stored.size), limit)
