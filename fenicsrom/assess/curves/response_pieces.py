"""The pieces of one response curve, in the order in which they are followed.

A curve starts at the first value of the range, where a few periods are marched and Newton's method
finds the periodic motion (`online.periodic.shooting`). It is followed through its folds to the
last value (`online.curves.continuation`). A curve that ends before is followed from the last
value too, so that both sides of a gap are known. Branches and isolated curves come last.
"""

from __future__ import annotations

import numpy as np

from fenicsrom.assess.curves.branches import Piece, follow_branches, follow_isolated
from fenicsrom.assess.curves.curve_progress import CurveWalk
from fenicsrom.assess.curves.response_problem import family_of, shooting_of, start_motion
from fenicsrom.assess.curves.response_results import ResponseCurve, response_table
from fenicsrom.assess.curves.trust import Richer, RicherModel, checks
from fenicsrom.errors import AccuracyError, ConvergenceError
from fenicsrom.online.curves.branching import follow_growing
from fenicsrom.online.curves.continuation import Continuation
from fenicsrom.online.curves.curve import CurvePoint
from fenicsrom.online.periodic.families import Family
from fenicsrom.online.periodic.shooting import PeriodicMotion
from fenicsrom.online.store.archive import StoredModel
from fenicsrom.progress import working_time
from fenicsrom.scene.units import in_words
from fenicsrom.words import counted

LARGEST_STEP = 0.03  # along a curve, in parts of the range and of the size of the motion


def follow_curve(
    stored: StoredModel, curve: ResponseCurve, walk: CurveWalk, richer: RicherModel | None
) -> None:
    """Compute the pieces of one curve, from where it stands, and estimate its errors.

    Raises:
        ConvergenceError, AccuracyError: no motion was found at either end of the range.
    """
    begin, table = working_time(), response_table(stored.scene)
    family = family_of(stored)
    error: ConvergenceError | AccuracyError | None = None
    try:
        for value, direction in ((table.first, 1.0), (table.last, -1.0)):
            earlier = [
                piece
                for piece in curve.pieces
                if piece.origin == "march" and piece.direction == direction
            ]
            start: PeriodicMotion | None = None
            if not earlier:
                try:
                    start = start_motion(stored, family, value, walk)
                except (ConvergenceError, AccuracyError) as problem:
                    error = problem
                    continue
                curve.pieces.append(Piece(direction=direction))
            piece = earlier[0] if earlier else curve.pieces[-1]
            if start is not None or piece.reason == "interrupted":
                _follow_piece(stored, family, start, value, piece, walk)
            reached = abs(piece.points[-1].parameter - table.last) <= 1e-9 * table.last
            if reached or piece.reason == "number of points":
                break
        if not curve.points and error is not None:
            raise error
        _follow_more(stored, family, curve, walk)
        other = None
        if richer is not None:
            other = Richer(family_of(richer.stored), richer.transfer)
        walk("checking the curve with half the step and a richer basis")
        curve.checks = checks(curve.pieces, family, stored.scene.time, other, lambda: walk(""))
    finally:
        marches = np.array([point.marches for point in curve.points + curve.special])
        total = marches.reshape(-1, 2).sum(axis=0)
        curve.marches = int(total[0]), int(total[1])
        curve.seconds += working_time() - begin


def _follow_piece(
    stored: StoredModel,
    family: Family,
    start: PeriodicMotion | None,
    value: float,
    piece: Piece,
    walk: CurveWalk,
) -> None:
    """Follow one piece from a motion, or on from where it stands.

    Args:
        stored: the model.
        family: problems by the parameter.
        start: the first motion; None continues from `walk.stand`.
        value: parameter at the first motion.
        piece: the piece.
        walk: reports and keeps what is done.

    Raises:
        ConvergenceError: the first point was not found.
    """
    table, shooting = response_table(stored.scene), shooting_of(stored, family)
    path = Continuation(shooting, family, table.first, table.last, 1.0)
    if start is not None:
        _begin_piece(path, start, value, piece, walk)

    def keep(point: CurvePoint) -> None:
        assert walk.stand is not None
        walk.passed(path, walk.stand.begin, walk.stand.since, walk.stand.direction)

    stand = walk.stand
    assert stand is not None
    path.size, shooting.guess = stand.size, stand.guess
    *earlier, last = stand.trail(piece)
    follow_growing(
        path,
        last,
        stand.direction,
        piece,
        points=table.points,
        step=stand.step,
        earlier=earlier,
        measured=lambda begin: walk.passed(path, begin, len(piece.points) - 1, None),
        largest_step=LARGEST_STEP,
        progress=keep,
    )
    walk.stand = None
    walk(f"{counted(len(piece.points), 'point')}, {piece.reason}")


def _begin_piece(
    path: Continuation, start: PeriodicMotion, value: float, piece: Piece, walk: CurveWalk
) -> None:
    """Find the first point of a piece; arguments and errors as `_follow_piece`."""
    s = path.shooting.scaled(start.z)
    path.size = float(np.linalg.norm(s))
    begin = path.at_parameter(s, value)
    if begin is None:
        here = in_words(walk.scene, response_table(walk.scene).parameter, value)
        raise ConvergenceError(f"the motion at {here} was lost")
    piece.points.append(begin)
    walk.passed(path, begin, 0, piece.direction)


def _follow_more(
    stored: StoredModel, family: Family, curve: ResponseCurve, progress: CurveWalk
) -> None:
    """Follow the branches and the isolated curves that the scene asks for.

    Raises:
        ConvergenceError, AccuracyError: no motion was found where isolated curves are sought.
    """
    table = response_table(stored.scene)

    def path_of(motion: CurvePoint, periods: int) -> Continuation:
        size = float(np.linalg.norm(motion.s))
        shooting = shooting_of(stored, family, periods)
        return Continuation(shooting, family, table.first, table.last, size)

    def follow(
        path: Continuation, begin: CurvePoint, direction: float | None, origin: str, periods: int
    ) -> None:
        piece = Piece(reason="interrupted", origin=origin, periods=periods)
        curve.pieces.append(piece)
        follow_growing(
            path,
            begin,
            direction,
            piece,
            points=table.points,
            largest_step=LARGEST_STEP,
            progress=lambda point: progress(""),
        )
        progress(f"{origin}: {counted(len(piece.points), 'point')}, {piece.reason}")

    def start(value: float) -> CurvePoint:
        motion = start_motion(stored, family, value, progress)
        s = shooting_of(stored, family).scaled(motion.z)
        size = float(np.linalg.norm(s))
        path = Continuation(shooting_of(stored, family), family, table.first, table.last, size)
        point = path.at_parameter(s, value)
        if point is None:
            here = in_words(stored.scene, table.parameter, value)
            raise ConvergenceError(f"the motion at {here} was lost")
        return point

    follow_branches(curve.pieces, path_of, follow, table.parameter, table.branches)
    follow_isolated(curve.pieces, path_of, follow, start, table.isolated or ())
