"""The pictures of a run: set-up, motion, contact, energy, shapes, stresses and animation."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.assess.errors.sizing import Sized
from fenicsrom.online.stress.reactions import Peak, Stresses
from fenicsrom.online.stress.stress import StressTable, von_mises
from fenicsrom.post.base.page import Page
from fenicsrom.post.base.picture import Drawn, Picture, draw_pictures, not_drawn, softly
from fenicsrom.post.base.plot import Plot
from fenicsrom.post.base.tables import place_text
from fenicsrom.post.body import body_figures, body_view
from fenicsrom.post.body import turning_view as turning
from fenicsrom.post.paraview import paraview
from fenicsrom.post.paraview.vtk import Grid, in_space, refined_grid
from fenicsrom.post.run.figures import HISTORY, plot_modes, plot_sizes
from fenicsrom.post.run.motion_figures import (
    CAPTIONS,
    Draw,
    motion_pictures,
    picture,
    plot_coordinates,
    run_up_pictures,
)
from fenicsrom.post.run.summary import STRESSES_FILE, SUMMARY, agreement_plot
from fenicsrom.post.setup import setup as scene_setup
from fenicsrom.records import Rerun, Study
from fenicsrom.scene import Scene, scene_heading

if TYPE_CHECKING:
    from fenicsrom.fem.solid.solid import Solid


ROWS_PER_FRAME = 2
"""An animation shows every second of the instants that ParaView gets."""

TITLE_WIDTH = 80  # characters of the set-up's title in a line

EQUILIBRIUM = "equilibrium"


def body_picture(heading: str, name: str, draw: Draw, numbers: str = "") -> Picture:
    """A picture of the body in space."""
    return picture(heading, name, draw, numbers, in_space=True)


@dataclass(eq=False)
class Body:
    """What all pictures of a body show; on the first rank.

    Attributes:
        grid: its mesh.
        values: the fields (n, 3) at the points of the mesh: the shapes, `EQUILIBRIUM`, and the
            displacements of the animation by the numbers of its frames, m.
        marks: what the picture of the set-up marks.
        titles: label of each shape -> its title.
    """

    grid: Grid
    values: dict[str, Array]
    marks: list[scene_setup.Mark]
    titles: dict[str, str]

    @cached_property
    def surface(self) -> body_view.PolyData:
        """The boundary, with the shapes and the equilibrium as point arrays."""
        shown = {label: self.values[label] for label in (*self.titles, EQUILIBRIUM)}
        return body_view.surface_of(self.grid, shown)

    @cached_property
    def view(self) -> body_view.View:
        """The projection of all pictures but that of the stresses."""
        moved = self.values[EQUILIBRIUM]
        if not moved.any() and self.titles:
            moved = self.values[next(iter(self.titles))]
        return scene_setup.setup_view(
            self.surface, self.marks, body_view.largest_of(moved) if moved.any() else None
        )

    def frames_at(self, surface: body_view.PolyData, count: int) -> Array:
        """The displacements (count, n, 3) of an animation from the equilibrium at a surface, m."""
        node = surface.point_data[body_view.NODE]
        rest = self.values[EQUILIBRIUM][node]
        return np.array([self.values[f"{k}"][node] - rest for k in range(count)])


def body_of(study: Study) -> Body | None:
    """What the pictures of the body of a study show; None on other ranks. Collective."""
    if study.body is None:
        kinds, solid = paraview.shapes(study), study.solid
        kinds.pop(EQUILIBRIUM, None)
        named = {label: field for fields in kinds.values() for label, field in fields.items()}
        fields = named | {EQUILIBRIUM: solid.field(solid.equilibrium)}
        if "reduced" in study.motions:
            moving = paraview.moving_field(study)
            fields |= {f"{k}": moving(row) for k, row in enumerate(_film_rows(study))}
        found = scene_setup.gathered_marks(solid, study.scene, fields)
        study.body = (None if found is None else Body(*found, shape_titles(study, named)),)
    return study.body[0]


def _film_rows(study: Study) -> range:
    """The rows of `frame_rows` that an animation shows."""
    return range(0, paraview.frame_rows(study.motions["reduced"]).size, ROWS_PER_FRAME)


def body_pictures(study: Study) -> list[Picture]:
    """List the pictures of the body; none on ranks other than the first. Collective."""
    body, scene = body_of(study), study.scene
    if body is None:
        return []
    labels = () if study.modes is None else study.modes.labels
    modes = [label for label in labels if not label.endswith("S")]
    largest = 1e3 * float(np.linalg.norm(body.values[EQUILIBRIUM], axis=1).max())
    title = f"equilibrium: largest displacement {largest:.4g} mm"
    seen = body.view
    setup = partial(scene_setup.setup_figure, body.grid, body.marks, _title(scene), seen)
    listed = [body_picture("Set-up", "setup", setup)]
    if body.titles:
        draw = partial(body_figures.shape_figure, body.surface, body.titles, modes, seen)
        listed.append(body_picture("Shapes", "shapes", draw))
    if study.solid.loaded:
        draw = partial(body_figures.deflection_figure, body.surface, EQUILIBRIUM, title, seen)
        listed.append(body_picture("Equilibrium", EQUILIBRIUM, draw))
    return listed


def setup_picture(solid: Solid, scene: Scene, name: str) -> Picture | None:
    """The picture of the set-up to a file; None on ranks other than the first. Collective."""
    found = scene_setup.gathered_marks(solid, scene, {})
    if found is None:
        return None
    grid, _, marks = found
    beside = [] if solid.cut is None else solid.cut.beside(grid.points)
    draw = partial(scene_setup.setup_figure, grid, marks, _title(scene), beside=beside)
    return replace(body_picture("Set-up", "setup", draw), name=name)


def setup_pictures(solid: Solid | None, scene: Scene) -> list[Picture]:
    """The picture of the set-up for a report, where the scene asks for pictures. Collective."""
    if solid is None or not scene.output.pictures:
        return []
    picture = setup_picture(solid, scene, "setup.png")
    return [] if picture is None else [picture]


def film_of(study: Study) -> body_figures.Film | None:
    """The last period of the reduced model about its equilibrium, to be animated. Collective.

    Returns:
        The film; None on ranks other than the first.
    """
    motion, body, rows = study.motions["reduced"], body_of(study), _film_rows(study)
    places: Array = np.zeros((0, 3))
    dots: Array = np.zeros((len(rows), 0, 3))
    states: Any = np.zeros((len(rows), 0))
    if study.scene.contacts:
        found, shift = paraview.contact_arrays(study, motion), paraview.contact_equilibrium(study)
        places = paraview.contact_places(study.points) + shift
        dots, states = found[paraview.DISPLACEMENT][rows] - shift, found[paraview.STATE][rows]
    if body is None:
        return None
    rest, times = (
        body.surface.warp_by_vector(EQUILIBRIUM),
        motion.time[paraview.frame_rows(motion)][rows],
    )
    moved = body.frames_at(rest, len(rows))
    return body_figures.Film(
        rest, times, moved, body.view, study.solid.loaded, dots, places, states
    )


def view(study: Study) -> Any:
    """The body as a widget for notebooks: turn it, and choose a shape, its motion or stress.

    It needs pyvista and k3d. The times of the motion follow those of the shapes.

    Args:
        study: the result of `run` or `modes`, on one rank.
    """
    found = _turning(study)
    return None if found is None else turning.turning_widget(*found)


def turning_view(study: Study) -> str | None:
    """A page on which the body turns, with its set-up, shapes, motion and stress. Collective.

    Returns:
        The HTML text; None on ranks other than the first.
    """
    found = _turning(study)
    return None if found is None else turning.turning_page(*found)


def _turning(study: Study) -> tuple[Any, list[dict[str, Any]]] | None:
    """What `turning_plot` gives of a study; None on ranks other than the first. Collective."""
    body = body_of(study)
    if body is None:
        return None
    surface, length = turning.simplified(body.surface), body.view.length
    still, plain = np.zeros((1, surface.n_points, 3)), np.full(surface.n_points, turning.UNPAINTED)
    count = len(body.titles)
    few = f"{turning.MOST_SHAPES} of {count} shapes are listed; the ParaView files hold all"
    shown = [turning.Shown("set-up", few * (count > turning.MOST_SHAPES), still, plain)]
    shown += [
        turning.swinging(title, surface.point_data[label], length)
        for label, title in list(body.titles.items())[: turning.MOST_SHAPES]
    ]
    rest = surface.point_data[EQUILIBRIUM]
    if study.solid.loaded:
        shown.append(turning.loaded(EQUILIBRIUM, rest, length))
    if "reduced" in study.motions:
        moved = body.frames_at(surface, len(_film_rows(study)))
        shown.append(turning.running("periodic motion", rest, moved, length))
    stresses = study.stresses
    if stresses is not None and study.recovery is not None and stresses.largest.von_mises:
        shown.append(_stressed(study.recovery.stress, stresses, surface, length))
    parts = scene_setup.symbols(body.marks, body.grid.points, length)
    parts += scene_setup.held_points(body.surface, body.marks)
    return turning.turning_plot(surface, shown, parts, body.view)


def _stressed(
    table: StressTable, found: Stresses, surface: body_view.PolyData, length: float
) -> turning.Shown:
    """The state of the largest von Mises stress at the points of a surface."""
    from scipy.spatial import cKDTree

    grid, values = stress_state(table, found.largest, found.measure)
    _, nearest = cKDTree(grid.points).query(surface.points)
    peak = float(values[body_figures.SIZE].max()) or 1.0
    name = f"von Mises stress, {found.largest.state}"
    entry = turning.loaded(name, values["displacement"][nearest], length)
    note = f"colour: 0 to {1e-6 * peak:.4g} MPa"
    return replace(entry, colours=values[body_figures.SIZE][nearest] / peak, note=note)


def stress_state(table: StressTable, peak: Peak, measure: str) -> tuple[Grid, dict[str, Array]]:
    """A grid with the displacement and the von Mises stress of a state, by their names."""
    grid, mean = refined_grid(table.vertex_position, table.cells)
    stress = table.at_vertices(table.stress(peak.coordinates, measure))
    moved = in_space(mean @ table.displacement(peak.coordinates))
    return grid, {"displacement": moved, body_figures.SIZE: von_mises(mean @ stress)}


def stress_picture(table: StressTable, peak: Peak, measure: str) -> Picture:
    """The picture of the von Mises stress of a state on the deformed body.

    Args:
        table: the table of the stresses.
        peak: the state.
        measure: the stress, one of `fenicsrom.online.stress.stress.MEASURES`.
    """
    when = "" if peak.time is None else f", t = {peak.time:.6g} s"
    place = place_text(peak.position)
    title = f"{peak.state}{when}: {1e-6 * peak.von_mises:.4g} MPa at {place} m"
    state = stress_state(table, peak, measure)

    def draw() -> Plot:
        return body_figures.stress_figure(body_view.surface_of(*state), "displacement", title)

    return body_picture("Von Mises stress", "stress", draw, STRESSES_FILE)


def shape_titles(study: Study, labels: Iterable[str]) -> dict[str, str]:
    """The titles of the shapes: the label, and the frequency of a normal mode."""
    titles = {label: label for label in labels}
    if study.modes is not None:
        for label, hertz in zip(study.modes.labels, study.modes.frequencies_hz, strict=False):
            titles[label] = f"{label}, {hertz:.5g} Hz"
    return titles


def _title(scene: Scene) -> str:
    """The heading of the set-up, with the speed of rotation."""
    speed = f", {scene.rotation.speed_rpm:g} rpm" if scene.rotation is not None else ""
    heading = scene_heading(scene)
    whole = heading if speed and speed.strip(", ") in heading else f"{heading}{speed}"
    return textwrap.fill(whole, TITLE_WIDTH)


def write_pictures(study: Study, folder: Path) -> list[Drawn]:
    """Draw the body, the motions and the shapes of a study, or warn why not. Collective.

    Raises:
        OSError: a file cannot be written.
    """
    bodies, along = body_pictures(study), _along_the_axis(body_of(study))
    coordinates, found = _coordinates(study), study.agreement
    if study.solid.comm.rank != 0:
        return []
    heading = "MAC of the reduced and the full modes"
    mac = [picture(heading, "mac", partial(agreement_plot, found), SUMMARY)] if found else []
    listed = [*bodies[:1], *motion_pictures(study), *coordinates, *bodies[1:], *along, *mac]
    return draw_pictures([*listed, *_of_sizes(study.sized)], folder, study.warnings)


def write_rerun_pictures(found: Rerun, folder: Path) -> list[Drawn]:
    """Draw the motion and the stresses of a stored model, or warn why not.

    Raises:
        OSError: a file cannot be written.
    """
    listed = [*run_up_pictures(found.run_up), *motion_pictures(found), *_of_sizes(found.sized)]
    return draw_pictures(listed, folder, found.warnings) + write_stress_picture(found, folder)


def _of_sizes(found: Sized | None) -> list[Picture]:
    """The picture of the error over the number of coordinates, if several were tried."""
    known = {n: e for n, e in (found.tried if found else {}).items() if np.isfinite(e)}
    if found is None or len(known) < 2:
        return []
    stored = found.stored
    draw = partial(plot_sizes, known, stored.size, stored.scene.basis.accuracy)
    return [picture("Error over the size of the basis", "sizes", draw, "")]


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
    return [picture("Modal coordinates", "coordinates", draw)]


def _along_the_axis(body: Body | None) -> list[Picture]:
    """The picture of the shapes along the axis of a straight slender body."""
    if body is None or not body.titles or not body_view.is_slender(body.grid.points):
        return []
    d = 2 if body_view.is_flat(body.grid.points) else 3
    points, fields = body.grid.points[:, :d], [body.values[label][:, :d] for label in body.titles]
    axis, *across = np.argsort(np.ptp(points, axis=0).max() - np.ptp(points, axis=0) > 0.0)
    names = [f"axial {'xyz'[axis]}", *(f"transverse {'xyz'[k]}" for k in sorted(across))]

    def draw() -> Plot:
        return plot_modes(list(body.titles), *centreline(points, np.array(fields)), names)

    return [picture("Shapes along the axis", "modes", draw, "")]


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
        file = body_figures.write_film(folder / "motion.gif", film)
        return [Drawn("Animation", file, CAPTIONS[file.name], HISTORY)]
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
