"""The pictures of the body: set-up, shapes, static deflection, stresses and animation."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.online.stress.stress import StressTable, von_mises
from fenicsrom.online.stress.stress_peaks import Peak, Stresses
from fenicsrom.post.base.picture import Picture
from fenicsrom.post.body.body_figures import SIZE, deflection_figure, shape_figure, stress_figure
from fenicsrom.post.body.body_surface import NODE, gathered_grid, surface_of
from fenicsrom.post.body.body_view import SLENDER, View, largest_of, view_of
from fenicsrom.post.body.film import Dots, Film
from fenicsrom.post.body.turning_view import (
    UNPAINTED,
    Shown,
    loaded,
    running,
    simplified,
    swinging,
    turning_page,
)
from fenicsrom.post.paraview.fields import (
    about_equilibrium,
    contact_points,
    frame_coordinates,
    frame_rows,
    shapes,
)
from fenicsrom.post.paraview.vtk_files import Grid, in_space, refined_grid
from fenicsrom.post.setup.setup_figure import setup_figure, setup_view
from fenicsrom.post.setup.setup_marks import marked, marks_of
from fenicsrom.post.setup.setup_symbols import held_points, symbols
from fenicsrom.scene import Scene, scene_heading

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from pyvista import PolyData

    from fenicsrom.fem.solid.solid import Solid
    from fenicsrom.records import Study

ROWS_PER_FRAME = 3
"""An animation shows every third of the instants that ParaView gets."""

TITLE_WIDTH = 80  # characters of the set-up's title in a line

EQUILIBRIUM = "equilibrium"


def body_pictures(study: Study) -> list[Picture]:
    """List the pictures of the body; none on ranks other than the first. Collective.

    All pictures of the study have the projection of the set-up.
    """
    solid = study.solid
    kinds = shapes(study)
    kinds.pop(EQUILIBRIUM, None)
    modes = list(kinds.get("normal_modes", ()))
    named = {label: field for fields in kinds.values() for label, field in fields.items()}
    regions = marked(solid, study.scene)
    fields = dict(regions.fields)
    if solid.loaded:
        fields[EQUILIBRIUM] = solid.equilibrium
    found = gathered_grid(solid.space, _filled(solid, fields) | named)
    if found is None:
        return []
    scene, titles = study.scene, shape_titles(study, named)
    grid, values = found
    seen = [EQUILIBRIUM] if solid.loaded else list(named)[:1]
    moved = largest_of(values[seen[0]]) if seen else None
    marks = marks_of(solid, scene, regions, grid.points, values)

    @cache
    def surface() -> tuple[PolyData, View]:
        """The surface with its fields, and the projection of all pictures but the stresses'."""
        shown = surface_of(grid, {label: values[label] for label in {*named, *seen}})
        study.view = setup_view(shown, marks, moved)
        return shown, study.view

    def draw_shapes() -> Figure:
        shown, view = surface()
        return shape_figure(shown, titles, modes, view)

    def draw_equilibrium() -> Figure:
        shown, view = surface()
        largest = 1e3 * float(np.linalg.norm(values[EQUILIBRIUM], axis=1).max())
        title = f"equilibrium: largest displacement {largest:.4g} mm"
        return deflection_figure(shown, EQUILIBRIUM, title, view)

    def draw_setup() -> Figure:
        return setup_figure(grid, marks, _title(scene), surface()[1])

    pictures = [Picture("Set-up", "setup.png", draw_setup, in_space=True)]
    if named:
        pictures.append(Picture("Shapes", "shapes.png", draw_shapes, in_space=True))
    if solid.loaded:
        pictures.append(Picture("Equilibrium", "equilibrium.png", draw_equilibrium, in_space=True))
    return pictures


def setup_picture(solid: Solid, scene: Scene, name: str) -> Picture | None:
    """The picture of the set-up to a file; None on ranks other than the first. Collective."""
    regions = marked(solid, scene)
    found = gathered_grid(solid.space, _filled(solid, regions.fields))
    if found is None:
        return None
    grid, values = found
    marks = marks_of(solid, scene, regions, grid.points, values)
    return Picture("Set-up", name, lambda: setup_figure(grid, marks, _title(scene)), in_space=True)


def setup_pictures(solid: Solid | None, scene: Scene) -> list[Picture]:
    """The picture of the set-up for a report, where the scene asks for pictures. Collective."""
    if solid is None or not scene.output.pictures:
        return []
    picture = setup_picture(solid, scene, "setup.png")
    return [] if picture is None else [picture]


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
    found = gathered_grid(solid.space, fields | {EQUILIBRIUM: solid.field(solid.equilibrium)})
    marks = contact_points(study, motion) if study.scene.contacts else None
    if marks is not None and solid.loaded:
        marks = about_equilibrium(study, *marks)
    if found is None:
        return None
    surface = surface_of(*found)
    rest = surface.warp_by_vector(EQUILIBRIUM)
    some = slice(None, None, ROWS_PER_FRAME)
    coordinates, times = frame_coordinates(motion)[some], motion.time[frame_rows(motion)][some]
    moved = np.tensordot(coordinates, np.array([surface.point_data[k] for k in fields]), 1)
    dots = None
    if marks is not None:
        dots = Dots(marks[0], marks[1]["displacement"][some], marks[1]["state"][some])
    view = study.view
    if view is None:
        shown = surface.point_data[EQUILIBRIUM] if solid.loaded else moved.reshape(-1, 3)
        view = view_of(rest, moved=largest_of(shown))
    return Film(rest, times, moved, view, solid.loaded, dots)


def turning_view(study: Study) -> str | None:
    """A page on which the body turns, with its set-up, shapes, motion and stress. Collective.

    Returns:
        The HTML text; None on ranks other than the first.
    """
    solid, kinds = study.solid, shapes(study)
    equilibrium = kinds.pop(EQUILIBRIUM, {})
    named = {label: field for fields in kinds.values() for label, field in fields.items()}
    regions = marked(solid, study.scene)
    film = film_of(study) if "reduced" in study.motions else None
    found = gathered_grid(
        solid.space,
        _filled(solid, regions.fields) | named | {EQUILIBRIUM: solid.field(solid.equilibrium)},
    )
    if found is None:
        return None
    grid, values = found
    marks = marks_of(solid, study.scene, regions, grid.points, values)
    whole = surface_of(grid, {label: values[label] for label in {*named, EQUILIBRIUM}})
    surface = simplified(whole)
    view = study.view or setup_view(whole, marks)
    titles, length = shape_titles(study, named), view.length
    still = np.zeros((1, surface.n_points, 3))
    shown = [Shown("set-up", "", still, np.full(surface.n_points, UNPAINTED))]
    shown += [swinging(titles[label], surface.point_data[label], length) for label in named]
    if equilibrium:
        shown.append(loaded("equilibrium", surface.point_data[EQUILIBRIUM], length))
    if film is not None:
        row = np.argsort(whole.point_data[NODE])
        kept = row[np.searchsorted(whole.point_data[NODE], surface.point_data[NODE], sorter=row)]
        rest = surface.point_data[EQUILIBRIUM]
        shown.append(running("periodic motion", rest, film.moved[:, kept], length))
    if study.stresses is not None and study.recovery is not None:
        shown.append(_stressed(study.recovery.stress, study.stresses, surface, length))
    parts = [symbol.part for symbol in symbols(marks, grid.points, view)]
    parts += held_points(whole, marks)
    return turning_page(surface, shown, parts, view)


def _stressed(table: StressTable, found: Stresses, surface: PolyData, length: float) -> Shown:
    """The state of the largest von Mises stress at the points of a surface."""
    from scipy.spatial import cKDTree

    grid, values = stress_state(table, found.largest, found.measure)
    _, nearest = cKDTree(grid.points).query(surface.points)
    peak = float(values[SIZE].max()) or 1.0
    name = f"von Mises stress, {found.largest.state}"
    entry = loaded(name, values["displacement"][nearest], length)
    note = f"colour: 0 to {1e-6 * peak:.4g} MPa"
    return replace(entry, colours=values[SIZE][nearest] / peak, note=note)


def stress_state(table: StressTable, peak: Peak, measure: str) -> tuple[Grid, dict[str, Array]]:
    """A grid with the displacement and the von Mises stress of a state, by their names."""
    grid, mean = refined_grid(table.vertex_position, table.cells)
    stress = table.at_vertices(table.stress(peak.coordinates, measure))
    moved = in_space(mean @ table.displacement(peak.coordinates))
    return grid, {"displacement": moved, SIZE: von_mises(mean @ stress)}


def stress_picture(table: StressTable, peak: Peak, measure: str) -> Picture:
    """The picture of the von Mises stress of a state on the deformed body.

    Args:
        table: the table of the stresses.
        peak: the state.
        measure: the stress, one of `fenicsrom.online.stress.stress.MEASURES`.
    """
    when = "" if peak.time is None else f", t = {peak.time:.6g} s"
    place = ", ".join(f"{x:.4g}" for x in peak.position)
    title = f"{peak.state}{when}: {1e-6 * peak.von_mises:.4g} MPa at ({place}) m"

    def draw() -> Figure:
        shown = surface_of(*stress_state(table, peak, measure))
        return stress_figure(shown, "displacement", title)

    return Picture("Von Mises stress", "stress.png", draw, in_space=True)


def shape_titles(study: Study, labels: Iterable[str]) -> dict[str, str]:
    """The titles of the shapes: the label, and the frequency of a normal mode."""
    titles = {label: label for label in labels}
    if study.modes is not None:
        for k, frequency in enumerate(study.modes.frequencies_hz):
            titles[f"{k + 1}V"] = f"{k + 1}V, {frequency:.5g} Hz"
    return titles


def is_slender(surface_points: Array) -> bool:
    """Whether the box around points (n, d) is `body_view.SLENDER` times as long as high."""
    extent = np.sort(np.ptp(surface_points, axis=0))
    return bool(extent[-1] >= SLENDER * extent[-2])


def _title(scene: Scene) -> str:
    """The heading of the set-up, with the speed of rotation."""
    turning = f", {scene.rotation.speed_rpm:g} rpm" if scene.rotation is not None else ""
    heading = scene_heading(scene)
    whole = heading if turning and turning.strip(", ") in heading else f"{heading}{turning}"
    return textwrap.fill(whole, TITLE_WIDTH)
