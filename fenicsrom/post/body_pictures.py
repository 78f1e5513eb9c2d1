"""The pictures of the body of a study: its set-up, its shapes and its static deflection."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.post.body_drawing import Marks, deflection_figure, setup_figure, shape_figure
from fenicsrom.post.body_surface import Surface, gathered_surface
from fenicsrom.post.fields import contact_places, shapes
from fenicsrom.post.picture import Picture
from fenicsrom.post.vtk_files import in_space
from fenicsrom.scene import Scene, scene_heading

if TYPE_CHECKING:
    from fenicsrom.fem.solid import Solid
    from fenicsrom.post.record import Study

SLENDER = 8.0
"""Ratio of the length to the height of the box around a straight slender body.

The sections of such a body move like points of its axis."""

TITLE_WIDTH = 80  # characters of the set-up's title in a line

CLAMPED, EQUILIBRIUM = "clamped", "equilibrium"


def body_pictures(study: Study) -> list[Picture]:
    """List the pictures of the body; none on ranks other than the first. Collective."""
    solid = study.solid
    named = {
        label: field
        for kind, fields in shapes(study).items()
        if kind != EQUILIBRIUM
        for label, field in fields.items()
    }
    clamped = np.zeros(solid.local)
    clamped[solid.clamped] = 1.0
    if solid.slanted is not None:
        clamped[solid.slanted.nodes * solid.dimension] = 1.0
    fields = {CLAMPED: clamped} | {_load(k): v for k, v in enumerate(solid.load_vectors.T)}
    if solid.loaded:
        fields[EQUILIBRIUM] = solid.equilibrium
    filled = {name: solid.field(values) for name, values in fields.items()}
    found = gathered_surface(solid.space, filled | named)
    if found is None:
        return []
    surface, values = found
    scene, titles = study.scene, shape_titles(study, named)
    pictures = [
        Picture(
            "Set-up",
            "setup.png",
            lambda: setup_figure(surface, marks_of(solid, scene, surface, values), _title(scene)),
        )
    ]
    if named:
        drawn = {label: values[label] for label in named}
        pictures.append(
            Picture("Shapes", "shapes.png", lambda: shape_figure(surface, drawn, titles))
        )
    if solid.loaded:
        displacement = values[EQUILIBRIUM]
        largest = 1e3 * float(np.linalg.norm(displacement, axis=1).max())
        title = f"equilibrium: largest displacement {largest:.4g} mm"
        pictures.append(
            Picture(
                "Equilibrium",
                "equilibrium.png",
                lambda: deflection_figure(surface, displacement, title),
            )
        )
    return pictures


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


def marks_of(solid: Solid, scene: Scene, surface: Surface, values: dict[str, Array]) -> Marks:
    """Supports, loads, contacts and probe of a scene on the points of its surface."""
    loads = {}
    middle = surface.points.mean(axis=0)
    for k, load in enumerate(scene.loads):
        forces = values[_load(k)]
        sizes = np.linalg.norm(forces, axis=1)
        total = forces.sum(axis=0)
        everywhere = load.everywhere
        place = middle if everywhere or not sizes.any() else sizes @ surface.points / sizes.sum()
        size = float(np.linalg.norm(total))
        direction = total / size if size > 0.0 else total
        direction = -direction if load.moves_supports else direction  # of the supports
        group = "" if everywhere else f' on "{load.place.group}"' if load.place.group else ""
        name = f"{load.kind}{group}"
        name = name if name not in loads else f"{name} ({k + 1})"
        on = (sizes > 0.0) & (not everywhere)
        loads[name] = np.asarray(place), direction, on
    contacts = {}
    points = solid.points
    places = contact_places(points)
    for k in range(len(scene.contacts)):
        mine = points.contact == k
        label = "contact" if len(scene.contacts) == 1 else f"contact {k + 1}"
        contacts[label] = places[mine], in_space(points.frame[mine, 0])
    probe = None if scene.contacts or np.isnan(solid.probe_position).any() else solid.probe_position
    return Marks(values[CLAMPED].max(axis=1) > 0.5, loads, contacts, probe)


def _title(scene: Scene) -> str:
    """The heading of the set-up, with the speed of rotation."""
    turning = f", {scene.rotation.speed_rpm:g} rpm" if scene.rotation is not None else ""
    heading = scene_heading(scene)
    whole = heading if turning and turning.strip(", ") in heading else f"{heading}{turning}"
    return textwrap.fill(whole, TITLE_WIDTH)


def _load(k: int) -> str:
    return f"load {k}"
