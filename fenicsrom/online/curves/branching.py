"""Other curves from a curve of periodic motions: branches, and motions at larger loads.

At a period doubling the motion has a multiplier -1. A branch of motions of twice as many periods
starts along its eigenvector. At a branch point the eigenvector of the multiplier +1 leads to a
branch of motions of as many periods. The first point of a branch is sought on a hyperplane normal
to the eigenvector, at a distance from the curve (Seydel 2010, chapter 5).

An isolated branch is reached through the loads: the motion is followed over a factor on the loads,
at a fixed parameter and through all folds. Each time the factor passes 1 there is a motion of the
problem.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.online.curves.arc import oriented
from fenicsrom.online.curves.continuation import Continuation
from fenicsrom.online.curves.curve import Curve, CurvePoint, norm
from fenicsrom.online.model.problem import Problem
from fenicsrom.online.periodic.families import force_family
from fenicsrom.online.periodic.shooting import Shooting

SWITCH = (0.02, 0.05, 0.1)  # distances from the curve at which a branch is sought
APART = 0.1  # of this distance: a motion that is nearer to the curve does not lie on a branch
SAME = 1e-5  # relative distance below which two motions are the same
LEAST_LOAD, LARGEST_LOAD = 0.01, 4.0  # factors on the loads through which other motions are sought
LOAD_POINTS = 1000  # largest number of points over the load


def branch(
    path: Continuation, point: CurvePoint, shooting: Shooting, sense: float = 1.0
) -> tuple[Continuation, CurvePoint] | None:
    """The first point of the branch that leaves a curve at a period doubling or branch point.

    Args:
        path: the continuation of the curve.
        point: the located bifurcation.
        shooting: the equation of the motions on the branch.
        sense: 1 or -1, the sense along the eigenvector.

    Returns:
        The continuation of the branch and its first point, whose tangent points away from the
        curve; None if no branch was found.
    """
    direction = _eigenvector(path, point)
    if direction is None:
        return None
    other = Continuation(shooting, path.family, path.low, path.high, point.s)
    along = other.direction(replace(point, tangent=np.append(sense * direction, 0.0)))
    for distance in SWITCH:
        start = other.correct(other.place(point) + distance * along, along, exact=True)
        if start is None or not path.low <= start.parameter <= path.high:
            continue
        same = path.at_parameter(point.s, start.parameter)
        apart = np.inf if same is None else norm(other.place(same) - other.place(start))
        if apart > APART * distance:
            turn = float(np.sign(start.tangent @ along)) or 1.0
            return other, oriented(start, turn * start.sense)
    return None


def _eigenvector(path: Continuation, point: CurvePoint) -> Array | None:
    """The real eigenvector (N,) of the multiplier at -1 or 1; None if the march fails."""
    monodromy = path.monodromy(point)
    if monodromy is None:
        return None
    values, vectors = np.linalg.eig(monodromy)
    target = -1.0 if point.kind == "period doubling" else 1.0
    vector = vectors[:, int(np.argmin(np.abs(values - target)))]
    real = np.real(vector * np.exp(-1j * np.angle(vector[np.argmax(np.abs(vector))])))
    return np.asarray(real)


def motions_through_load(shooting: Shooting, problem: Problem, s: Array) -> list[CurvePoint]:
    """The motions of a problem that are connected with one of them through the size of the loads.

    Args:
        shooting: the equation of the motion.
        problem: the problem.
        s: (N,) scaled variables of one motion.

    Returns:
        The points at which the factor on the loads is 1, without the start; empty if no periodic
        load exists, or if the motion was not found.
    """
    family = force_family(problem)
    if not np.any(family(1.0).drift.sines):
        return []
    found: list[CurvePoint] = []
    for direction in (1.0, -1.0):
        path = Continuation(shooting, family, LEAST_LOAD, LARGEST_LOAD, s)
        start = path.at_parameter(s, 1.0)
        if start is None:
            return found
        curve = path.run(start, direction, points=LOAD_POINTS, locate=False)
        for _, _, near in Curve(curve.points[1:]).crossings(1.0):
            point = path.at_parameter(near, 1.0)
            if point is not None and not any(_same(point, other) for other in [start, *found]):
                found.append(point)
        if curve.reason == "closed":
            break
    return found


def _same(a: CurvePoint, b: CurvePoint) -> bool:
    """Whether two motions at the same parameter are the same."""
    return float(np.linalg.norm(a.s - b.s)) < SAME * float(np.linalg.norm(b.s))


def passes_through(path: Continuation, curve: Curve, point: CurvePoint) -> bool:
    """Whether a curve passes a point, or ends there, within a part of its steps."""
    y = path.place(point)
    for a, b in pairwise(curve.points):
        first, chord = path.place(a), path.place(b) - path.place(a)
        length = float(np.linalg.norm(chord))
        if length == 0.0:
            continue
        share = min(max(float(chord @ (y - first)) / length**2, 0.0), 1.0)
        if np.linalg.norm(first + share * chord - y) < APART * length:
            return True
    return False


def lies_on(path: Continuation, curve: Curve, point: CurvePoint) -> bool:
    """Whether a motion belongs to a curve.

    The motions of the curve at the parameter of the point are computed and compared with it.
    """
    for _, _, near in curve.crossings(point.parameter):
        found = path.at_parameter(near, point.parameter)
        if found is not None and _same(found, point):
            return True
    return False
