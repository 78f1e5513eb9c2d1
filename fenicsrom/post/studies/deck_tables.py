"""The tables of a starter scene that repeat a deck: attachments, contacts, ties, static loads."""

import math
from collections.abc import Sequence

from fenicsrom.fem.mesh.inspection import Inspection
from fenicsrom.formats.mesh_file import AXES, DeckLoad
from fenicsrom.scene.base.tables import toml_value as toml

LAYER = 10.0
"""Stiffness of a contact that is rigid in the file: that of a layer of a tenth of a facet."""


def attachment_lines(found: Inspection) -> list[str]:
    """The tables of point masses and springs of the file."""
    lines: list[str] = []
    d, springs = found.geometry.dimension, found.physics.springs
    for point, mass in found.physics.masses:
        lines += ["", "[[attachments]]", f"node = {list(point[:d])}", f"mass = {mass!r}"]
    for point, stiffness in dict.fromkeys((point, value) for point, _, value in springs):
        along = [AXES[k] for at, k, value in springs if (at, value) == (point, stiffness)]
        lines += ["", "[[attachments]]", f"node = {list(point[:d])}", f"stiffness = {stiffness!r}"]
        if len(along) < d:
            lines.append(f"components = {toml(along)}")
    return lines


def joint_lines(found: Inspection, steel: float) -> list[str]:
    """The tables of the contacts and ties of the file, the finer surface first.

    Args:
        found: the mesh.
        steel: Young's modulus where the file has none, in the units of the scene.
    """
    lines: list[str] = []
    sizes = {
        group.name: (group.size / group.number) ** (1.0 / (found.geometry.dimension - 1))
        for group in found.groups
        if group.kind == "facets" and group.size
    }
    moduli = [material.young for material in found.physics.materials if material.young is not None]
    young = moduli[0] if moduli else steel
    for joint in found.physics.joints:
        pair = joint.group, joint.against
        if missing := [name for name in pair if name not in sizes]:
            what = f"{joint.name}: no whole facet lies on the surface {missing[0]}"
            lines += ["", f"# not taken from the file: {what}"]
            continue
        first, second = sorted(pair, key=lambda name: sizes[name])  # stable
        lines += ["", f"{'[[ties]]' if joint.tied else '[[contacts]]'} # of the file: {joint.name}"]
        lines += [f"group = {toml(first)}", f"against = {toml(second)}"]
        lines += [f"reach = {joint.reach!r}"] if joint.reach is not None else []
        if joint.tied:
            continue
        chosen = f"{LAYER * young / sizes[first]:.2g}"
        why = f" # chosen: {LAYER:g} E/h with the size h of a facet; the file has no linear law"
        normal = f"{chosen}{why}" if joint.normal is None else f"{joint.normal!r}"
        slope = joint.tangential or joint.normal
        tangential = f"{chosen}{why}" if slope is None else f"{slope!r}"
        lines += ["gap = 0.0 # ADJUST closes the gaps"] if joint.shut else []
        lines += [f"normal_stiffness = {normal}", f"tangential_stiffness = {tangential}"]
        lines.append(f"friction = {joint.friction!r}")
    return lines


def static_lines(loads: Sequence[DeckLoad], d: int) -> list[str]:
    """The tables of the static loads of the file."""
    lines: list[str] = []
    for load in loads:
        lines.append("[[loads]] # static, of the file")
        if load.kind == "pressure":
            lines += [f"group = {toml(load.group or '')}", f"pressure = {load.vector[0]!r}", ""]
            continue
        size = math.hypot(*load.vector)
        if load.point is not None:
            lines.append(f"node = {list(load.point[:d])}")
        if load.group is not None:
            lines.append(f"group = {toml(load.group)}")
        direction = [float(f"{value / size:.12g}") + 0.0 for value in load.vector[:d]]
        lines += [f"direction = {direction}", f"{load.kind} = {size!r}", ""]
    return lines
