"""The periodic motions at the marked points of response curves, as arrays and for ParaView."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from fenicsrom.assess.curves.response_problem import family_of
from fenicsrom.assess.curves.response_results import Response, ResponseCurve, curve_title
from fenicsrom.errors import ConvergenceError
from fenicsrom.online.contact.surfaces import Contacts
from fenicsrom.online.curves.curve import BIFURCATIONS, CurvePoint
from fenicsrom.online.motion.motion import Motion
from fenicsrom.online.periodic.periodic_record import recorded_motion
from fenicsrom.online.store.archive import StoredModel
from fenicsrom.post.base.chart import Detail
from fenicsrom.post.base.writers import write_arrays
from fenicsrom.post.curves.response_figures import (
    height_of,
    largest_component,
    state_names,
)
from fenicsrom.post.paraview.fields import write_last_period
from fenicsrom.scene.reading.units import in_words

if TYPE_CHECKING:
    from fenicsrom.records import Study

ARCHIVE = "motions.npz"
MOST_CLICKED = 32  # motions that a click on a response curve shows
MOST_SAMPLES = 150  # of a motion that a click shows
FOLDER = "motions"


class MarkedMotion(NamedTuple):
    """The periodic motion at a marked point.

    Attributes:
        parameter: parameter of the curve.
        motion: one period.
        contacts: parameters of the contact points.
    """

    parameter: float
    motion: Motion
    contacts: Contacts


def largest_point(found: Response, curve: ResponseCurve) -> CurvePoint:
    """The point of the largest amplitude of a curve."""
    return max(curve.points, key=height_of(found))


def marked_points(found: Response) -> dict[str, tuple[ResponseCurve, CurvePoint]]:
    """The bifurcations and the largest amplitude of each curve, by names for files."""
    marked = {}
    for number, curve in enumerate(found.curves, 1):
        prefix = f"curve_{number}_" if len(found.curves) > 1 else ""
        marked[f"{prefix}largest"] = (curve, largest_point(found, curve))
        for kind in BIFURCATIONS:
            mine = [point for point in curve.special if point.kind == kind]
            for k, point in enumerate(mine, 1):
                marked[f"{prefix}{kind.replace(' ', '_').replace('-', '_')}_{k}"] = (curve, point)
    return marked


def marked_motions(found: Response, stored: StoredModel) -> dict[str, MarkedMotion]:
    """The periodic motions at the marked points; a motion that is lost becomes a warning."""
    motions = {}
    for name, (curve, point) in marked_points(found).items():
        try:
            motions[name] = _motion(found, stored, curve, point)
        except ConvergenceError as error:
            found.warnings.append(f"the motion {name} was not written: {error}")
    return motions


def _motion(
    found: Response, stored: StoredModel, curve: ResponseCurve, point: CurvePoint
) -> MarkedMotion:
    """The periodic motion at a point.

    Raises:
        ConvergenceError: the motion is lost.
    """
    families = found.table.families
    if families is not None:
        stored = stored.with_overrides([f"{families.key}={curve.value!r}"])
    problem = family_of(stored)(point.parameter)
    motion = recorded_motion(problem, point.z, point.periods)
    return MarkedMotion(point.parameter, motion, problem.contacts)


def clicked_motions(
    found: Response, stored: StoredModel, known: dict[str, MarkedMotion]
) -> list[Detail]:
    """What a click shows: the known motions at marked points, and others evenly along each curve.

    A motion that is lost is left out.
    """
    details = []
    for name, (curve, point) in marked_points(found).items():
        if name in known:
            details.append(_detail(found, curve, point, known[name].motion))
    each = max(0, MOST_CLICKED - len(details)) // len(found.curves)
    for curve in found.curves:
        for point in curve.points[:: max(1, -(-len(curve.points) // max(1, each)))][:each]:
            with suppress(ConvergenceError):
                motion = _motion(found, stored, curve, point).motion
                details.append(_detail(found, curve, point, motion))
    return details


def _detail(found: Response, curve: ResponseCurve, point: CurvePoint, motion: Motion) -> Detail:
    """What a click on a point shows: a period of its motion at the contact point."""
    where = in_words(found.scene, found.table.parameter, point.parameter)
    states = f", {', '.join(state_names(point))}" if found.contacts else ""
    title = f"The motion at {curve_title(found.scene, curve.value)}{where}: {point.verdict}{states}"
    place, direction = largest_component(found)
    some = slice(None, None, max(1, motion.time.size // MOST_SAMPLES))
    moved = 1e3 * motion.displacement[some, place]
    lines = [(motion.time[some] - motion.time[0], moved[:, direction])]
    if found.contacts:
        lines.append((moved[:, 1], motion.force[some, place, 1]))
    return Detail(title, (point.parameter, height_of(found)(point)), lines)


def write_motion_arrays(motions: dict[str, MarkedMotion], folder: Path) -> Path:
    """Write the motions as the arrays `NAME_time`, `NAME_coordinates` and so on.

    Raises:
        OSError: the file cannot be written.
    """
    kept = ("time", "coordinates", "velocity", "displacement", "force", "gap", "state")
    arrays: dict[str, Any] = {}
    for name, (parameter, motion, _) in motions.items():
        arrays[f"{name}_parameter"] = parameter
        arrays |= {f"{name}_{attribute}": getattr(motion, attribute) for attribute in kept}
    return write_arrays(folder / ARCHIVE, arrays)


def write_motion_fields(study: Study, motions: dict[str, MarkedMotion], folder: Path) -> list[Path]:
    """Write the motions for ParaView, one folder each. Collective.

    Raises:
        OSError: a file cannot be written.
    """
    files = []
    for name, (_, motion, contacts) in motions.items():
        one = replace(study, motions={"reduced": motion})
        files += write_last_period(one, folder / FOLDER / name, contacts)
    return files
