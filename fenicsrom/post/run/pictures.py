"""The pictures of a run: motion, contact, energy, shapes and the animation."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.assess.errors.signals import LEAST_SAMPLES
from fenicsrom.online.contact.points import ContactPoints
from fenicsrom.online.motion.measures import is_unsteady, point_summaries
from fenicsrom.post.base.captions import caption
from fenicsrom.post.base.directions import direction_names
from fenicsrom.post.base.html_page import Page
from fenicsrom.post.base.picture import Drawn, Picture, draw_pictures, not_drawn, softly
from fenicsrom.post.body.body_surface import is_flat
from fenicsrom.post.body.body_view import is_slender
from fenicsrom.post.body.centreline import centreline
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
from fenicsrom.scene import Scene
from fenicsrom.scene.keys.excitation import surface_spin

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from fenicsrom.assess.errors.sizing import Sized
    from fenicsrom.online.motion.motion import Motion
    from fenicsrom.online.stress.recovery import Recovery
    from fenicsrom.online.stress.stress_peaks import Stresses
    from fenicsrom.records import Study

LEAST_PERIODS = 3.5  # fewer periods show no trend of the energies
NO_FREQUENCIES = np.zeros(0)
LEAST_SECTION = 20  # fewer periods make no section


def motion_pictures(
    motions: Mapping[str, Motion],
    natural_hz: Array = NO_FREQUENCIES,
    names: Sequence[str] = (),
    work: str = LOADS,
    points: ContactPoints | None = None,
) -> list[Picture]:
    """List the pictures of the motion, of the contact and of the energy.

    A motion without a period has its spectra, one that has a period but does not repeat its
    Poincare section, many contact points have a map, and a run of several periods its energies
    per period.

    Args:
        motions: model name -> motion.
        natural_hz: (n,) natural frequencies, Hz.
        names: names of the directions.
        work: what does work.
        points: the contact points.
    """
    first = next(iter(motions.values()))
    pictures = [Picture("Motion", "motion.png", lambda: plot_motion(motions, names=names))]
    if first.period is None and first.time.size >= LEAST_SAMPLES:
        pictures.append(
            Picture("Spectra", "spectra.png", lambda: plot_transient(first, natural_hz, 0, names))
        )
    if is_unsteady(first) and first.periods >= LEAST_SECTION:
        pictures.append(
            Picture("Poincaré section", "section.png", lambda: plot_section(first, 0, names))
        )
    pictures += _contact_pictures(motions, first.force.shape[1], names, points)
    if first.state.shape[1] > FEW_POINTS and touching_points(motions):
        pictures.append(Picture("Rub map", "rub_map.png", lambda: plot_rub_map(first, points)))
    pictures.append(Picture("Energy", "energy.png", lambda: plot_energy(first, work)))
    if first.load_period is not None and first.time[-1] > LEAST_PERIODS * first.load_period:
        pictures.append(
            Picture(
                "Energy per period",
                "energy_per_period.png",
                lambda: plot_energy_per_period(first, work),
            )
        )
    return pictures


def working(scene: Scene) -> str:
    """Say what does work: the loads, and the surfaces if one of them moves or turns."""
    turning = [
        surface_spin(contact.surface, scene.rotation)
        for contact in scene.contacts
        if contact.surface is not None
    ]
    moving = any(turning) or any(contact.approach for contact in scene.contacts)
    return LOADS_AND_SURFACES if moving else LOADS


def _contact_pictures(
    motions: Mapping[str, Motion],
    count: int,
    names: Sequence[str],
    points: ContactPoints | None,
) -> list[Picture]:
    """List the pictures of contact points: one for each of a few points, or one for many points."""
    touching = touching_points(motions)
    if not touching:
        return []
    if count > FEW_POINTS:

        def draw_all() -> Figure:
            found = {
                name: point_summaries(motion)
                for name, motion in motions.items()
                if motion.state.shape[1]
            }
            return plot_points(motions, found, names, points)

        return [Picture(f"Contact of {count} points", "contact.png", draw_all)]

    def draw(point: int) -> Callable[[], Figure]:
        mine = {name: motion for name, motion in motions.items() if motion.force.shape[1] > point}
        return lambda: plot_contact(mine, point, names)

    if count == 1:
        return [Picture("Contact", "contact.png", draw(0))]
    return [
        Picture(f"Contact point {point + 1}", f"contact_{point + 1}.png", draw(point))
        for point in touching
    ]


def write_pictures(study: Study, folder: Path) -> list[Drawn]:
    """Draw the body, the motions and the shapes of a study, or warn why not. Collective.

    Raises:
        OSError: a file cannot be written.
    """
    bodies, along = body_pictures(study), _along_the_axis(body_of(study))
    coordinates = _coordinates(study)
    if study.solid.comm.rank != 0:
        return []
    natural = study.modes.frequencies_hz if study.modes is not None else NO_FREQUENCIES
    names = direction_names(study.scene, study.solid.points)
    work = working(study.scene)
    motions = []
    if study.motions:
        motions = motion_pictures(study.motions, natural, names, work, study.solid.points)
    listed = [*bodies[:1], *motions, *coordinates, *bodies[1:], *along, *_agreement(study)]
    listed += size_pictures(study.sized)
    return draw_pictures(listed, folder, study.warnings)


def size_pictures(found: Sized | None) -> list[Picture]:
    """The picture of the error over the run time, of a nonlinear model with several sizes."""
    if found is None or len(found.sizes) < 2:
        return []
    return [
        Picture(
            "Error over run time",
            "sizes.png",
            lambda: plot_sizes(found.sizes, found.stored.size),
        )
    ]


def _agreement(study: Study) -> list[Picture]:
    """The picture of the modes of the reduced and the full model, if they were compared."""
    found = study.agreement
    if found is None:
        return []
    return [
        Picture("MAC of the reduced and the full modes", "mac.png", lambda: agreement_figure(found))
    ]


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
    labels = modes.labels[:count]
    return [
        Picture(
            "Modal coordinates",
            "coordinates.png",
            lambda: plot_coordinates(motion, labels, modal),
        )
    ]


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


def write_stress_picture(
    recovery: Recovery, stresses: Stresses, folder: Path, notes: list[str]
) -> list[Drawn]:
    """Draw the von Mises stress at the instant of its maximum; add a warning to the notes.

    A body without stress, such as that of normal modes without loads, has no picture.

    Raises:
        OSError: the file cannot be written.
    """
    if not stresses.largest.von_mises:
        return []
    picture = stress_picture(recovery.stress, stresses.largest, stresses.measure)
    return draw_pictures([picture], folder, notes)
