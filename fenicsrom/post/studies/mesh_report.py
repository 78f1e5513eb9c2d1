"""The output of `fenicsrom inspect`: a table of the mesh and its groups, and a picture."""

from collections import Counter
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.fem.mesh.inspection import Group, Inspection
from fenicsrom.formats.mesh_file import AXES, Physics
from fenicsrom.notes import Note, NoteKind
from fenicsrom.post.base.picture import Picture, softly
from fenicsrom.post.base.style import missing_module
from fenicsrom.post.base.tables import place_text, table_of, text_table, write_text
from fenicsrom.post.body.group_drawing import group_figure, group_page
from fenicsrom.post.studies.starter import units_of
from fenicsrom.words import counted

PAGE = "mesh.html"
"""The page on which the body turns."""

COLOURED = 12
"""Largest number of groups that the picture colours; the largest ones of all facets and nodes."""

MEASURES = {("cells", 3): "m³", ("cells", 2): "m²", ("facets", 3): "m²", ("facets", 2): "m"}
"""Units of the size of a group, by its kind and the dimension of the mesh."""


def lines(found: Inspection, density: float | None) -> list[str]:
    """Describe the mesh in lines of text.

    Args:
        found: the mesh.
        density: density in kg/m³, for the mass, or None.
    """
    d = found.geometry.dimension
    kinds = ", ".join(f"{number} {name}" for name, number in found.cells.items()) or "no cells"
    text = [
        f"cells   {kinds}; {found.nodes} nodes; {d}D",
        f"box     {_box(found.low, found.high)} m",
    ]
    if found.volume:
        text.append(
            f"{'volume ' if d == 3 else 'area   '} {found.volume:.6g} {'m³' if d == 3 else 'm²'}"
        )
        if density is not None:
            per = "" if d == 3 else " for each metre of thickness"
            text.append(f"mass    {density * found.volume:.6g} kg{per}, with {density:g} kg/m³")
        text.append(
            f"quality {found.quality:.3g} at worst (1: equal sides), at {place_text(found.worst)}"
        )
        text.append(f"curved  geometry.curved = true {found.curved}")
    if found.pieces > 1:
        text.append(f"pieces  {found.pieces} that share no node; each needs a support")
    if hint := scale_hint(found):
        text.append(f"hint    {hint}")
    text += _physics_lines(found.physics)
    if found.groups:
        text += ["", text_table(table_of(_group_row(group, d) for group in found.groups))]
    return text


def _group_row(group: Group, d: int) -> dict[str, str]:
    """The row of a group in the table of a mesh of dimension d."""
    return {
        "group": group.name,
        "kind": "corners" if group.kind == "nodes" else group.kind,
        "number": str(group.number),
        "size": "" if group.size is None else f"{group.size:.4g}",
        "": "" if group.size is None else MEASURES[group.kind, d],
        "from": place_text(group.low),
        "to": place_text(group.high),
    }


def _physics_lines(physics: Physics) -> list[str]:
    """Say what a finite-element model holds besides its mesh."""
    parts = [
        f"{material.name} (E = {material.young:g}, ν = {material.poisson:g}, "
        f"ρ = {'none' if material.density is None else f'{material.density:g}'})"
        for material in physics.materials
        if material.young is not None
    ]
    parts += [
        f"support {place if isinstance(place, str) else f'at {place_text(place)}'} "
        f"({', '.join(AXES[k] for k in held)})"
        for place, held in physics.supports
    ]
    kinds = Counter("tie" if joint.tied else "contact" for joint in physics.joints)
    parts += [counted(number, kind) for kind, number in kinds.items()]
    several = {
        "point mass": (physics.masses, "point masses"),
        "spring": (physics.springs, ""),
        "static load": (physics.loads, ""),
    }
    parts += [counted(len(v), noun, many) for noun, (v, many) in several.items() if v]
    lines = [f"model   {', '.join(parts)}; `fenicsrom init` writes them"] if parts else []
    return lines + [f"not taken: {what}" for what in physics.not_taken]


def scale_hint(found: Inspection) -> str:
    """Advise on the units of a file that is most likely not in SI units, or ""."""
    units, why = units_of(found, None)
    if units.is_si:
        return why
    scale = f"geometry.scale = {units.factor('m')}"
    return f"the units are probably {units.names} ({why}), not m; give them in [units], or {scale}"


def _box(low: Array, high: Array) -> str:
    return " × ".join(f"{a:.6g} to {b:.6g}" for a, b in zip(low, high, strict=True))


def group_picture(found: Inspection) -> Picture:
    """The picture of a mesh that can be used, with its groups coloured."""
    draw, caption = partial(group_figure, *_drawn(found)), "The mesh with its groups."
    return Picture("Mesh", "mesh.png", draw, caption, in_space=True)


def write_group_page(found: Inspection, folder: Path, notes: list[Note]) -> list[Path]:
    """Write the page of a body in space to turn, or a note why it cannot be written.

    Raises:
        OSError: the file cannot be written.
    """
    if found.geometry.dimension != 3:
        return []
    if reason := missing_module("k3d", "pyvista"):
        notes.append(Note(NoteKind.NOT_DRAWN, f"{PAGE} was not written: {reason}", PAGE))
        return []
    with softly(PAGE, notes):
        return [write_text(folder / PAGE, group_page(*_drawn(found)))]
    return []


def _drawn(found: Inspection) -> tuple[Array, Any, dict[str, Any]]:
    """Points, boundary and members of the groups that are drawn, the coloured ones first."""
    assert found.points is not None and found.boundary is not None
    small = sorted(_shown(found), key=lambda group: group.number)
    few, more = small[:COLOURED], small[COLOURED:]
    few.sort(key=lambda group: (group.name.zfill(9), group.name))
    chosen = [*few, *(group for group in more if group.kind == "facets")]
    members = {group.name: np.asarray(group.members) for group in chosen}
    return found.points, found.boundary, members


def _shown(found: Inspection) -> list[Group]:
    """The groups of facets, and of nodes that are no facets; without the whole boundary."""
    assert found.boundary is not None
    facets = {group.name for group in found.groups if group.kind == "facets"}
    return [
        group
        for group in found.groups
        if (group.kind == "facets" and group.number < len(found.boundary))
        or (group.kind == "nodes" and group.name not in facets)
    ]
