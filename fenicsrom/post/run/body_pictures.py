"""The pictures of the body: set-up, shapes, static deflection, stresses and animation."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.online.stress.stress import StressTable, von_mises
from fenicsrom.online.stress.stress_peaks import Peak
from fenicsrom.post.base.picture import Picture
from fenicsrom.post.body.body_figures import deflection_figure, shape_figure, stress_figure
from fenicsrom.post.body.body_surface import Surface, gathered_surface, surface_of
from fenicsrom.post.body.body_view import View, largest_of, view_of
from fenicsrom.post.body.film import Dots, Film
from fenicsrom.post.body.surface_detail import (
    LEAST_OF_MANY,
    LEAST_SMOOTH,
    for_picture,
    simplified,
)
from fenicsrom.post.paraview.fields import (
    about_equilibrium,
    contact_points,
    frame_coordinates,
    frame_rows,
    shapes,
)
from fenicsrom.post.paraview.vtk_files import in_space, refined_grid
from fenicsrom.post.setup.setup_figure import setup_figure, setup_view
from fenicsrom.post.setup.setup_marks import Marks, marked, marks_of
from fenicsrom.scene import Scene, scene_heading

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from fenicsrom.fem.solid.solid import Solid
    from fenicsrom.records import Study

SLENDER = 8.0
"""Ratio of the length to the height of the box around a straight slender body.

The sections of such a body move like points of its axis."""

ROWS_PER_FRAME = 2
"""An animation shows every second of the instants that ParaView gets."""

TITLE_WIDTH = 80  # characters of the set-up's title in a line

EQUILIBRIUM = "equilibrium"


def body_pictures(study: Study) -> list[Picture]:
    """List the pictures of the body; none on ranks other than the first. Collective.

    All pictures of the study have the projection of the set-up.
    """
    solid = study.solid
    named = {
        label: field
        for kind, fields in shapes(study).items()
        if kind != EQUILIBRIUM
        for label, field in fields.items()
    }
    regions = marked(solid, study.scene)
    fields = dict(regions.fields)
    if solid.loaded:
        fields[EQUILIBRIUM] = solid.equilibrium
    found = gathered_surface(solid.space, _filled(solid, fields) | named)
    if found is None:
        return []
    scene, titles = study.scene, shape_titles(study, named)
    surface, values = found
    seen = [EQUILIBRIUM] if solid.loaded else list(named)[:1]
    moved = largest_of(values[seen[0]]) if seen else None
    marks = marks_of(solid, scene, regions, surface.points, values)
    view = study.view = setup_view(surface, marks, moved)

    def draw_shapes() -> Figure:
        shown = {label: values[label] for label in named}
        return shape_figure(*for_picture(surface, shown, LEAST_OF_MANY), titles, view)

    def draw_equilibrium() -> Figure:
        shown, found = for_picture(surface, {EQUILIBRIUM: values[EQUILIBRIUM]})
        largest = 1e3 * float(np.linalg.norm(values[EQUILIBRIUM], axis=1).max())
        title = f"equilibrium: largest displacement {largest:.4g} mm"
        return deflection_figure(shown, found[EQUILIBRIUM], title, view)

    pictures = [_setup(scene, surface, marks, view)]
    if named:
        pictures.append(Picture("Shapes", "shapes.png", draw_shapes))
    if solid.loaded:
        pictures.append(Picture("Equilibrium", "equilibrium.png", draw_equilibrium))
    return pictures


def setup_picture(solid: Solid, scene: Scene, name: str) -> Picture | None:
    """The picture of the set-up to a file; None on ranks other than the first. Collective."""
    regions = marked(solid, scene)
    found = gathered_surface(solid.space, _filled(solid, regions.fields))
    if found is None:
        return None
    surface, values = found
    marks = marks_of(solid, scene, regions, surface.points, values)
    return _setup(scene, surface, marks, setup_view(surface, marks), name)


def setup_pictures(solid: Solid | None, scene: Scene) -> list[Picture]:
    """The picture of the set-up for a report, where the scene asks for pictures. Collective."""
    if solid is None or not scene.output.pictures:
        return []
    picture = setup_picture(solid, scene, "setup.png")
    return [] if picture is None else [picture]


def _setup(
    scene: Scene, surface: Surface, marks: Marks, view: View, name: str = "setup.png"
) -> Picture:
    """The picture of the set-up from the marks on the whole surface."""

    def draw() -> Figure:
        shown, kept = simplified(surface)
        return setup_figure(shown, marks.at(kept), _title(scene), view)

    return Picture("Set-up", name, draw)


def _filled(solid: Solid, fields: Mapping[str, Array]) -> dict[str, Any]:
    """Fields with ghost values from fields (local,)."""
    return {name: solid.field(values) for name, values in fields.items()}


def film_of(study: Study) -> Film | None:
    """The last period of the reduced model about its equilibrium, to be animated. Collective.

    Returns:
        The film; None on ranks other than the first.
    """
    motion, solid, basis = study.motions["reduced"], study.solid, study.basis
    assert basis is not None
    fields = {f"{k}": solid.field(vector) for k, vector in enumerate(basis.vectors.T)}
    found = gathered_surface(solid.space, fields | {EQUILIBRIUM: solid.field(solid.equilibrium)})
    marks = contact_points(study, motion) if study.scene.contacts else None
    if marks is not None and solid.loaded:
        marks = about_equilibrium(study, *marks)
    if found is None:
        return None
    surface, values = for_picture(*found, LEAST_SMOOTH)
    equilibrium = values.pop(EQUILIBRIUM)
    rest = replace(surface, points=surface.points + equilibrium)
    some = slice(None, None, ROWS_PER_FRAME)
    coordinates, times = frame_coordinates(motion)[some], motion.time[frame_rows(motion)][some]
    moved = np.tensordot(coordinates, np.array(list(values.values())), 1)
    dots = None
    if marks is not None:
        dots = Dots(marks[0], marks[1]["displacement"][some], marks[1]["state"][some])
    view = study.view
    if view is None:
        most = largest_of(equilibrium if solid.loaded else moved.reshape(-1, 3))
        view = view_of(rest.points, rest.triangles, moved=most)
    return Film(rest, times, moved, view, solid.loaded, dots)


def stress_picture(
    table: StressTable, peak: Peak, measure: str, view: View | None = None
) -> Picture:
    """The picture of the von Mises stress of a state on the deformed body.

    Args:
        table: the table of the stresses.
        peak: the state.
        measure: the stress, one of `fenicsrom.online.stress.stress.MEASURES`.
        view: the projection; by default one in which the largest stress is seen.
    """
    when = "" if peak.time is None else f", t = {peak.time:.6g} s"
    place = ", ".join(f"{x:.4g}" for x in peak.position)
    title = f"{peak.state}{when}: {1e-6 * peak.von_mises:.4g} MPa at ({place}) m"

    def draw() -> Figure:
        grid, mean = refined_grid(table.vertex_position, table.cells)
        stress = table.at_vertices(table.stress(peak.coordinates, measure))
        values = {
            "displacement": in_space(mean @ table.displacement(peak.coordinates)),
            "von Mises": von_mises(mean @ stress),
        }
        surface, found = for_picture(surface_of(grid), values)
        return stress_figure(surface, found["displacement"], found["von Mises"], title, view)

    return Picture("Von Mises stress", "stress.png", draw)


def shape_titles(study: Study, labels: Iterable[str]) -> dict[str, str]:
    """The titles of the shapes: the label, and the frequency of a normal mode."""
    titles = {label: label for label in labels}
    if study.modes is not None:
        for k, frequency in enumerate(study.modes.frequencies_hz):
            titles[f"{k + 1}V"] = f"{k + 1}V, {frequency:.5g} Hz"
    return titles


def is_slender(surface_points: Array) -> bool:
    """Whether the box around points (n, d) is `SLENDER` times as long as high."""
    extent = np.sort(np.ptp(surface_points, axis=0))
    return bool(extent[-1] >= SLENDER * extent[-2])


def _title(scene: Scene) -> str:
    """The heading of the set-up, with the speed of rotation."""
    turning = f", {scene.rotation.speed_rpm:g} rpm" if scene.rotation is not None else ""
    heading = scene_heading(scene)
    whole = heading if turning and turning.strip(", ") in heading else f"{heading}{turning}"
    return textwrap.fill(whole, TITLE_WIDTH)
