"""The pictures of a run: motion, contact, energy, shapes and the animation."""

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.assess.errors.signals import LEAST_SAMPLES
from fenicsrom.assess.errors.sizing import Sized
from fenicsrom.online.contact.points import ContactPoints, contacts_of
from fenicsrom.online.motion.measures import is_unsteady
from fenicsrom.online.motion.motion import Motion
from fenicsrom.online.motion.wear import wear_of, worn_under_points
from fenicsrom.post.base.captions import caption
from fenicsrom.post.base.directions import direction_names
from fenicsrom.post.base.html_page import Page
from fenicsrom.post.base.picture import Drawn, Picture, draw_pictures, not_drawn, softly
from fenicsrom.post.base.style import Figure
from fenicsrom.post.body.body_view import is_flat, is_slender
from fenicsrom.post.body.film import write_film
from fenicsrom.post.run.body_pictures import (
    Body,
    body_of,
    body_pictures,
    film_of,
    stress_picture,
    turning_view,
)
from fenicsrom.post.run.figures import (
    LOADS,
    LOADS_AND_SURFACES,
    plot_contact,
    plot_energy,
    plot_modes,
    plot_motion,
    plot_points,
    plot_sizes,
)
from fenicsrom.post.run.mode_agreement import agreement_figure
from fenicsrom.post.run.motion_figures import (
    plot_coordinates,
    plot_energy_per_period,
    plot_rub_map,
    plot_section,
    plot_transient,
)
from fenicsrom.post.run.motion_table import FEW_POINTS, touching_points
from fenicsrom.post.run.run_up import run_up_pictures
from fenicsrom.post.run.summary import probe_motions
from fenicsrom.post.run.wear import plot_wear, plot_wear_over_time
from fenicsrom.records import Rerun, Study
from fenicsrom.scene import Scene
from fenicsrom.scene.keys.schema import surface_spin

LEAST_PERIODS = 3.5  # fewer periods show no trend of the energies
LEAST_SECTION = 20  # fewer periods make no section


def motion_pictures(found: Study | Rerun) -> list[Picture]:
    """List the pictures of the motions, of the contact, of the energy and of the wear of a run."""
    if not found.motions:
        return []
    motions, points = found.motions, found.points
    names, work = direction_names(found.scene, points), working(found.scene)
    first = next(iter(motions.values()))
    listed = [Picture("Motion", "motion.png", lambda: plot_motion(motions, names))]
    if probes := probe_motions(found):
        listed.append(Picture("Motion of the probe", "probe.png", lambda: plot_motion(probes)))
    if first.period is None and first.time.size >= LEAST_SAMPLES:
        draw = partial(plot_transient, first, found.frequencies_hz, names)
        listed.append(Picture("Spectra", "spectra.png", draw))
    if is_unsteady(first) and first.periods >= LEAST_SECTION:
        draw = partial(plot_section, first, names)
        listed.append(Picture("Poincaré section", "section.png", draw))
    listed += _contact_pictures(motions, names, points)
    if first.state.shape[1] > FEW_POINTS and touching_points(motions):
        listed.append(Picture("Rub map", "rub_map.png", lambda: plot_rub_map(first, points)))
    listed.append(Picture("Energy", "energy.png", lambda: plot_energy(first, work)))
    if first.time[-1] / (first.load_period or np.inf) > LEAST_PERIODS:
        draw = partial(plot_energy_per_period, first, work)
        listed.append(Picture("Energy per period", "energy_per_period.png", draw))
    if "reduced" in motions:
        listed += wear_pictures(motions["reduced"], found.scene, points)
    return listed


def wear_pictures(motion: Motion, scene: Scene, points: ContactPoints) -> list[Picture]:
    """The picture of the worn depth of abradable layers: of a casing, or before single points."""
    found = wear_of(motion, scene, points)
    if rings := [one for one in found if one.ring.radius]:
        return [Picture("Wear of the casing", "wear.png", lambda: plot_wear(rings))]
    if not found:
        return []
    worn = worn_under_points(motion, contacts_of(scene, points))
    mine = [one.ring.points[0] for one in found]
    draw = partial(plot_wear_over_time, motion.time, worn, mine)
    return [Picture("Wear of the layer", "wear.png", draw)]


def working(scene: Scene) -> str:
    """Say what does work: the loads, and the surfaces if one of them moves, turns or wears."""
    turning = [
        surface_spin(contact.surface, scene.rotation)
        for contact in scene.contacts
        if contact.surface is not None
    ]
    moving = any(turning) or scene.wears or any(contact.approach for contact in scene.contacts)
    return LOADS_AND_SURFACES if moving else LOADS


def _contact_pictures(
    motions: Mapping[str, Motion], names: Sequence[str], points: ContactPoints | None
) -> list[Picture]:
    """List the pictures of contact points: one for each of a few points, or one for many points."""
    touching, count = touching_points(motions), next(iter(motions.values())).force.shape[1]
    if count > FEW_POINTS and touching:
        heading = f"Contact of {count} points"
        return [Picture(heading, "contact.png", lambda: plot_points(motions, names, points))]

    def picture(point: int) -> Picture:
        mine = {name: motion for name, motion in motions.items() if motion.force.shape[1] > point}
        heading = f"Contact point {point + 1}" if count > 1 else "Contact"
        file = f"contact_{point + 1}.png" if count > 1 else "contact.png"
        return Picture(heading, file, lambda: plot_contact(mine, point, names))

    return [picture(point) for point in touching]


def write_pictures(study: Study, folder: Path) -> list[Drawn]:
    """Draw the body, the motions and the shapes of a study, or warn why not. Collective.

    Raises:
        OSError: a file cannot be written.
    """
    bodies, along = body_pictures(study), _along_the_axis(body_of(study))
    coordinates, found = _coordinates(study), study.agreement
    if study.solid.comm.rank != 0:
        return []
    name = "MAC of the reduced and the full modes"
    agreement = [Picture(name, "mac.png", lambda: agreement_figure(found))] if found else []
    listed = [*bodies[:1], *motion_pictures(study), *coordinates, *bodies[1:], *along, *agreement]
    return draw_pictures([*listed, *_of_sizes(study.sized)], folder, study.warnings)


def write_rerun_pictures(found: Rerun, folder: Path) -> list[Drawn]:
    """Draw the motion and the stresses of a stored model, or warn why not.

    Raises:
        OSError: a file cannot be written.
    """
    listed = [*run_up_pictures(found.run_up), *motion_pictures(found), *_of_sizes(found.sized)]
    return draw_pictures(listed, folder, found.warnings) + write_stress_picture(found, folder)


def _of_sizes(found: Sized | None) -> list[Picture]:
    """The picture of the error over the run time, of a nonlinear model with several sizes."""
    if found is None or len(found.sizes) < 2:
        return []
    size = found.stored.size
    return [Picture("Error over run time", "sizes.png", lambda: plot_sizes(found.sizes, size))]


def _coordinates(study: Study) -> list[Picture]:
    """The picture of the modal coordinates of the reduced motion. Collective."""
    motion, basis, modes = study.motions.get("reduced"), study.basis, study.modes
    if motion is None or basis is None or modes is None or motion.coordinates is None:
        return []
    count = modes.normal.shape[1]
    if not count:
        return []
    parts = study.solid.mass_inner(modes.normal, basis.vectors)
    modal = motion.coordinates @ parts.T * study.solid.largest(modes.normal)
    draw = partial(plot_coordinates, motion, modes.labels[:count], modal)
    return [Picture("Modal coordinates", "coordinates.png", draw)]


def _along_the_axis(body: Body | None) -> list[Picture]:
    """The picture of the shapes along the axis of a straight slender body."""
    if body is None or not body.titles or not is_slender(body.grid.points):
        return []
    d = 2 if is_flat(body.grid.points) else 3
    points, fields = body.grid.points[:, :d], [body.values[label][:, :d] for label in body.titles]
    axis, *across = np.argsort(np.ptp(points, axis=0).max() - np.ptp(points, axis=0) > 0.0)
    names = [f"axial {'xyz'[axis]}", *(f"transverse {'xyz'[k]}" for k in sorted(across))]

    def draw() -> Figure:
        return plot_modes(list(body.titles), *centreline(points, np.array(fields)), names)

    return [Picture("Shapes along the axis", "modes.png", draw)]


def turning_pages(study: Study) -> list[Page]:
    """The page on which the body turns; none, and a warning, if it cannot be made. Collective."""
    if sentence := not_drawn(["the view to turn"], in_space=True):
        study.warnings.append(sentence)
        return []
    page = None
    with softly("the view to turn", study.warnings):
        page = turning_view(study)
    return [] if page is None else [Page(page)]


def write_animation(study: Study, folder: Path) -> list[Drawn]:
    """Animate the last period of the reduced model about its equilibrium as a GIF. Collective.

    Raises:
        OSError: the file cannot be written.
    """
    if sentence := not_drawn(["motion.gif"], in_space=True):
        study.warnings.append(sentence)
        return []
    film = film_of(study)
    if film is None:
        return []
    with softly("motion.gif", study.warnings):
        file = write_film(folder / "motion.gif", film)
        return [Drawn("Animation", file, caption(file.name))]
    return []


def write_stress_picture(found: Study | Rerun, folder: Path) -> list[Drawn]:
    """Draw the von Mises stress at the instant of its maximum, or warn why not.

    A body without stress, such as that of normal modes without loads, has no picture.

    Raises:
        OSError: the file cannot be written.
    """
    stresses, recovery = found.stresses, found.recovery
    if stresses is None or recovery is None or not stresses.largest.von_mises:
        return []
    picture = stress_picture(recovery.stress, stresses.largest, stresses.measure)
    return draw_pictures([picture], folder, found.warnings)


INSIDE = 1e-13
"""Distance of the ends of the centreline from those of the body, relative to its length."""


def centreline(points: Array, values: Array, stations: int = 101) -> tuple[Array, Array]:
    """Sample fields along the axis of a slender body, for `plot_modes`.

    The axis is the coordinate direction in which the body is longest, through the middle of the
    box around it. Fields are linear between neighbouring nodes, also across a hollow section: a
    section that rotates has no axial displacement in its middle.

    Args:
        points: (n, d) nodes, m.
        values: (f, n, d) fields at the nodes.
        stations: number of points along the axis; those outside of the body are left out.

    Returns:
        Positions (k,) in m, from the smallest to the largest coordinate, and values (f, k, d), the
        axial component first, then the others in order.
    """
    from scipy.interpolate import LinearNDInterpolator

    low, high = points.min(axis=0), points.max(axis=0)
    axis = int(np.argmax(high - low))
    order = [axis, *(k for k in range(points.shape[1]) if k != axis)]
    line = np.tile((low + high) / 2.0, (stations, 1))
    spare = INSIDE * (high - low)[axis]
    positions = np.linspace(low[axis], high[axis], stations)
    line[:, axis] = positions.clip(low[axis] + spare, high[axis] - spare)
    found = LinearNDInterpolator(points, np.moveaxis(values, 0, 1))(line)
    inside = ~np.isnan(found).any(axis=(1, 2))
    return positions[inside], np.moveaxis(found[inside], 1, 0)[..., order]
