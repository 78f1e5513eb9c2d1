"""The periodic motions at the marked points of response curves, as arrays and for ParaView."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from fenicsrom.assess.curves.response_problem import family_of
from fenicsrom.assess.curves.response_results import Response, ResponseCurve
from fenicsrom.errors import ConvergenceError
from fenicsrom.online.contact.surfaces import Contacts
from fenicsrom.online.curves.curve import BIFURCATIONS, CurvePoint
from fenicsrom.online.motion.motion import Motion
from fenicsrom.online.periodic.periodic_record import recorded_motion
from fenicsrom.online.store.archive import StoredModel
from fenicsrom.post.base.writers import write_arrays
from fenicsrom.post.curves.response_figures import largest_direction
from fenicsrom.post.paraview.fields import write_last_period

if TYPE_CHECKING:
    from fenicsrom.records import Study

ARCHIVE = "motions.npz"
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
    direction = largest_direction(found)
    return max(curve.points, key=lambda point: float(point.amplitude[:, direction].max()))


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
    families, motions = found.table.families, {}
    for name, (curve, point) in marked_points(found).items():
        current = stored
        if families is not None:
            current = stored.with_overrides([f"{families.key}={curve.value!r}"])
        problem = family_of(current)(point.parameter)
        try:
            motion = recorded_motion(problem, point.z, point.periods)
        except ConvergenceError as error:
            found.warnings.append(f"the motion {name} was not written: {error}")
            continue
        motions[name] = MarkedMotion(point.parameter, motion, problem.contacts)
    return motions


def write_motion_arrays(motions: dict[str, MarkedMotion], folder: Path) -> Path:
    """Write the motions as the arrays `NAME_time`, `NAME_coordinates` and so on.

    Raises:
        OSError: the file cannot be written.
    """
    arrays: dict[str, Any] = {}
    for name, (parameter, motion, _) in motions.items():
        arrays |= {
            f"{name}_parameter": parameter,
            f"{name}_time": motion.time,
            f"{name}_coordinates": motion.coordinates,
            f"{name}_velocity": motion.velocity,
            f"{name}_displacement": motion.displacement,
            f"{name}_force": motion.force,
            f"{name}_gap": motion.gap,
            f"{name}_state": motion.state,
        }
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
