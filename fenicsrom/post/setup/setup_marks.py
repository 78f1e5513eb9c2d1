"""The marks in the picture of the set-up: supports, loads, attachments, contacts and probe.

All of it belongs to the undeformed body, which the picture shows: the arrow of a pressure is normal
to the face that is drawn, also if the pressure follows the deformation.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.errors import SceneError
from fenicsrom.post.body.body_view import gathered_grid
from fenicsrom.post.body.surface_mesh import surface_grid
from fenicsrom.post.paraview.fields import contact_places
from fenicsrom.post.paraview.vtk import Grid, in_space
from fenicsrom.scene import Contact, Load, Place, Scene, Support
from fenicsrom.scene.base.tables import keys
from fenicsrom.scene.keys.loads import ACTIONS, Harmonics, Pulse, Sweep
from fenicsrom.scene.keys.unit_system import Units

if TYPE_CHECKING:
    from fenicsrom.fem.solid.solid import Solid

CLAMPED = "support, clamped"
"""The label of supports that hold every component."""

WEIGHTY = 0.1
"""Smaller nodal forces of a pressure, relative to the largest, do not show its direction."""

LOAD_UNITS = {name: rule.unit for kind in ACTIONS.kinds for name, rule, *_ in keys(kind)}
"""Key of the size of a load -> its unit."""

ARROW = r"$\rightarrow$"
"""The marker of an arrow in the legend."""

CONTACT_FORMS = ("o", "s", "D", "^")
"""Markers of the contacts: sphere, cube, octahedron and cone."""

ATTACHED_FORMS = {"mass": "s", "spring": "D", "dashpot": "^"}
"""The same of attachments."""


ATTACHED = (("mass", "mass", "kg"), ("stiffness", "spring", "N/m"), ("damping", "dashpot", "N s/m"))
"""Keys of an attachment, its kind and the unit; the last two have a key for each area, too."""


@dataclass(frozen=True, eq=False)
class Mark:
    """One thing in the picture of the set-up.

    Attributes:
        kind: "support", "load", "attachment", "contact", "probe" or "rotation".
        label: its name in the legend.
        marker: its marker in the legend, as in matplotlib.
        places: (k, 3) where it is: tips of arrows, contact points, a point of the axis, m.
        ways: unit vectors: (c, 3) held directions, (1, 3) direction of a load or axis of rotation,
            which turns the body by the right-hand rule, or (k, 3) normals into the wall.
        on: (n,) whether a point of the body belongs to the region; empty without a region.
        wall: the round surface of a contact; None of a plane.
    """

    kind: str
    label: str
    marker: str
    places: Array
    ways: Array = field(default_factory=lambda: np.zeros((0, 3)))
    on: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, dtype=bool))
    wall: Grid | None = None


def gathered_marks(
    solid: Solid, scene: Scene, fields: Mapping[str, Any]
) -> tuple[Grid, dict[str, Array], list[Mark]] | None:
    """Find the marks of a scene. Collective.

    Args:
        solid: the body.
        scene: its scene.
        fields: more fields on the body, by their names.

    Returns:
        The grid of the body, the values (n, 3) of the fields at its points, and the marks; None on
        ranks other than the first.
    """
    regions = _regions(solid, scene)
    placed: list[tuple[str, Any]] = [
        (f"{name}[{k}]", one)
        for name in ("loads", "attachments")
        for k, one in enumerate(getattr(scene, name))
        if name != "loads" or not (one.everywhere or one.kind == "pressure")
    ]
    at = {found.place: solid.place(found.place, key)[1] for key, found in placed}
    every: list[Any] = [*scene.attachments, *scene.contacts]
    lengths = {
        found.place: solid.mesh.unit_lengths(found.place) if _is_region(found.place) else 0
        for found in every
    }
    gathered = gathered_grid(
        solid.space, {name: solid.field(field) for name, field in regions.items()} | {**fields}
    )
    if gathered is None:
        return None
    grid, values = gathered
    marks = _support_marks(scene, grid.points, values)
    marks += [_load_mark(scene, k, grid.points, values, at) for k in range(len(scene.loads))]
    marks += [
        Mark("attachment", label, ATTACHED_FORMS[kind], at[found.place][None])
        for found in scene.attachments
        for kind, label in _attached(found, scene.units, lengths[found.place])
    ]
    forms = zip(itertools.cycle(CONTACT_FORMS), scene.contacts, strict=False)
    for k, (form, contact) in enumerate(forms):
        mine = solid.points.contact == k
        label = f"contact{f' {k + 1}' * (len(scene.contacts) > 1)}"
        label += _pressed(contact, scene.units, lengths[contact.place])
        places, normals = contact_places(solid.points)[mine], in_space(solid.points.frame[mine, 0])
        marks.append(Mark("contact", label, form, places, normals, wall=_round(solid, scene, k)))
    if not (scene.contacts and scene.probe is None) and not np.isnan(solid.probe_position).any():
        marks.append(Mark("probe", "probe", "*", solid.probe_position[None]))
    if scene.rotation is not None:
        speed = scene.rotation.speed_rpm
        point = in_space(np.array([scene.rotation.point or np.zeros(solid.dimension)]))
        axis = np.copysign(1.0, speed) * np.array([scene.rotation.axis or (0.0, 0.0, 1.0)])
        label = f"axis of rotation, {abs(speed):g} rpm"
        marks.append(Mark("rotation", label, ARROW, point, axis / np.linalg.norm(axis)))
    return grid, values, marks


def _regions(solid: Solid, scene: Scene) -> dict[str, Array]:
    """Fields (local,): 1 at the first component of the nodes of a region, or nodal forces."""
    from fenicsrom.fem.body.supports import support_directions

    d = solid.dimension
    fields: dict[str, Array] = {}

    def mark(label: str, nodes: Any) -> None:
        fields[label] = np.zeros(solid.local)
        fields[label][nodes[nodes < solid.local // d] * d] = 1.0

    for k, support in enumerate(scene.supports):
        mark(f"support {k}", support_directions(solid.mesh, solid.space, support, scene.source)[0])
    for k, load in enumerate(scene.loads):
        if load.kind == "pressure":
            fields[f"pressure {k}"] = solid.load_vector(load, f"loads[{k}]")
        if not load.everywhere and _is_region(load.place) and load.place.at == "mean":
            mark(f"load {k}", solid.mesh.nodes(load.place, solid.space))
    return fields


def _is_region(place: Place) -> bool:
    """Whether a place is a region, and not given by the coordinates of a point."""
    return place.node is None and place.nearest is None


def _round(solid: Solid, scene: Scene, k: int) -> Grid | None:
    """The round surface of contact k; None of a plane.

    Of a surface that cuts into the undeformed body, none is drawn: a run refuses it.
    """
    try:
        return surface_grid(scene, solid.points, k, 0.0) if scene.contacts[k].surface else None
    except SceneError:
        return None


def _support_marks(scene: Scene, points: Array, values: Mapping[str, Array]) -> list[Mark]:
    """The supports, those with the same directions together."""
    marks: dict[str, Mark] = {}
    for k, support in enumerate(scene.supports):
        label, directions = _held(support, scene.geometry.dimension)
        on = values[f"support {k}"][:, 0] > 0.5
        if label in marks:
            on = on | marks[label].on
        marks[label] = Mark("support", label, "<", points[on], directions, on)
    return list(marks.values())


def _held(support: Support, d: int) -> tuple[str, Array]:
    """The label of a support and its held directions (c, 3); empty if the support holds all."""
    if support.normal is not None:
        along = ", ".join(f"{x:.3g}" for x in support.normal)
        return f"support, held along ({along})", in_space(np.array([support.normal]))
    axes = support.components or tuple("xyz"[:d])
    if len(set(axes)) == d:
        return CLAMPED, np.zeros((0, 3))
    held = np.eye(3)[["xyz".index(axis) for axis in axes]]
    return f"support, held along {' and '.join(axes)}", held


def _load_mark(
    scene: Scene, k: int, points: Array, values: Mapping[str, Array], at: Mapping[Place, Array]
) -> Mark:
    """The mark of a load. A motion of the supports has an arrow at each of them."""
    load = scene.loads[k]
    on = values.get(f"load {k}", np.zeros((0, 3)))[:, 0] > 0.5
    direction = in_space(np.array(load.direction or (), dtype=float))
    if load.moves_supports:
        held = [values[f"support {n}"][:, 0] > 0.5 for n in range(len(scene.supports))]
        places = np.array([points[found].mean(axis=0) for found in held])
    elif load.everywhere:
        places = points.mean(axis=0)[None]
    elif load.kind == "pressure":
        forces = values[f"pressure {k}"]
        sizes = np.linalg.norm(forces, axis=1)
        middle = sizes @ points / sizes.sum()
        weighty = np.flatnonzero(sizes > WEIGHTY * sizes.max())
        nearest = weighty[np.argmin(np.linalg.norm(points[weighty] - middle, axis=1))]
        places, direction = points[[nearest]], forces[nearest] / sizes[nearest]
    else:
        places = at[load.place][None]
    number = f"{k + 1}: " * (len(scene.loads) > 1)
    way = np.copysign(1.0, load.size) * direction[None]
    return Mark("load", f"{number}{_load_label(load)}", ARROW, places, way, on)


def _load_label(load: Load) -> str:
    """Kind, place, size and history of a load."""
    where = ""
    if not load.everywhere and load.place.group is not None:
        where = f' on "{load.place.group}"'
    history = "static" if load.static else f"{load.frequency:g} Hz" if load.frequency else "table"
    if isinstance(load.history, Harmonics):
        history = f"harmonics of {history}"
    elif isinstance(load.history, Sweep):
        history = f"{history} to {load.history.sweep.to:g} Hz"
    elif isinstance(load.history, Pulse):
        history = "pulse"
    size = f"{abs(load.size):g} {LOAD_UNITS[load.kind]}"
    kind = f"{'follower ' * load.follower}{load.kind.replace('_', ' ')}"
    return f"{kind}{where}, {size}, {history}"


def _pressed(contact: Contact, units: Units, lengths: int) -> str:
    """The preload or the gap of a contact, as a part of its label."""
    if contact.preload and contact.place.at == "nodes":
        return f", preload {units.per_region(contact.preload, 'N', lengths)}"
    if contact.preload:
        return f", preload {contact.preload:g} N"
    return f", gap {1e3 * contact.gap:g} mm" if contact.gap else ""


def _attached(attachment: Any, units: Units, lengths: int) -> list[tuple[str, str]]:
    """The kinds and the labels of the parts of an attachment."""
    along = " in each direction"
    if attachment.components is not None:
        along = f" along {', '.join(attachment.components)}"
    found = []
    for key, kind, unit in ATTACHED:
        if size := getattr(attachment, key):
            found.append((kind, f"{kind}, {size:g} {unit}{along * (kind != 'mass')}"))
        if size := getattr(attachment, f"{key}_per_area", 0.0):
            label = f"{kind}, {units.per_region(size, unit, lengths)}{along}"
            found.append((kind, label))
    return found
