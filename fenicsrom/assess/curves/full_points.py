"""The motions of the full model at some points of the response curves of its reduced model."""

from __future__ import annotations

from fenicsrom.arrays import Array
from fenicsrom.assess.curves.response_problem import family_of
from fenicsrom.assess.curves.response_results import (
    FullPoint,
    Response,
    ResponseCurve,
    curve_title,
    response_table,
)
from fenicsrom.assess.full.full_periodic import full_periodic_motion
from fenicsrom.errors import ConvergenceError, job_error
from fenicsrom.fem.solid.solid import Solid
from fenicsrom.notes import Note, NoteKind
from fenicsrom.online.periodic.families import Family
from fenicsrom.online.periodic.shooting import PeriodicMotion, Shooting, solve
from fenicsrom.online.store.archive import StoredModel
from fenicsrom.progress import log
from fenicsrom.scene.reading.units import in_words

REDUCED_TOLERANCE = 1e-8  # of the residual of the reduced motion, relative to the variables


def add_full_points(found: Response, stored: StoredModel, solid: Solid, basis: Array) -> None:
    """Compute the motions of the full model that a scene asks for, and add them to its curves.

    At each value of `response.full` the reduced motion is taken from the curve: the stable motion
    with the largest amplitude or, if all motions are unstable, the motion with the largest
    amplitude. If a motion is not found, a warning is added, and `found.unfinished` holds the error.

    Args:
        found: the curves.
        stored: the reduced model.
        solid: the solid it was made from.
        basis: (local, n) vectors of its basis.
    """
    families = found.table.families
    try:
        for curve in found.curves:
            current, begin = stored, ""
            if families is not None:
                current = stored.with_values({families.key: curve.value})
                begin = curve_title(found.scene, curve.value)
            family = family_of(current)
            for value in found.table.full_values:
                name = f"{begin}full model at {in_words(found.scene, found.table.parameter, value)}"
                try:
                    shooting, reduced = _reduced_motion(current, family, curve, value)
                    log.info(f"  {name}")
                    motion = full_periodic_motion(solid, basis, shooting, reduced)
                except Exception as problem:
                    error = job_error(problem)
                    note = Note(NoteKind.LEFT_OUT, f"{name}: {error}", curve=begin)
                    found.warnings.append(note)
                    found.unfinished = found.unfinished or error
                    continue
                curve.full.append(
                    FullPoint(
                        value,
                        motion.amplitude,
                        reduced.amplitude,
                        reduced.verdict,
                        motion.periods,
                        motion.derived,
                        motion.residuals[-1],
                        motion.seconds,
                    )
                )
    except KeyboardInterrupt:
        found.interrupted = True


def _reduced_motion(
    stored: StoredModel, family: Family, curve: ResponseCurve, value: float
) -> tuple[Shooting, PeriodicMotion]:
    """The equation and the reduced motion of a curve at a value of the parameter.

    Raises:
        ConvergenceError: the curve has no motion there.
    """
    crossings = [found for piece in curve.pieces for found in piece.crossings(value)]
    crossings.sort(
        key=lambda found: (
            found[0].stable and found[1].stable,
            max(float(point.amplitude.max()) for point in found[:2]),
        ),
        reverse=True,
    )
    shooting = Shooting(family(value))
    for _, _, near in crossings:
        try:
            return shooting, solve(shooting, near, REDUCED_TOLERANCE)
        except ConvergenceError:
            continue
    key = response_table(stored.scene).parameter
    raise ConvergenceError(f"the response curve has no motion at {key} = {value:.6g}")
