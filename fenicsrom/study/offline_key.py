"""Hashes of all that decides the offline results of a scene: the names of cache entries.

The hashes cover the content of the mesh file and the scene with its defaults. A key of the scene
matters unless it is left out here.
"""

from __future__ import annotations

from dataclasses import fields
from typing import Any

from fenicsrom.online.store.result_cache import key_of, mesh_digest
from fenicsrom.online.store.scene_changes import CONTACT_KEYS, SURFACE_KEYS
from fenicsrom.scene import Contact, Load, Scene, Surface, scene_table
from fenicsrom.scene.base.rules import BY_MOTION
from fenicsrom.scene.base.tables import plain
from fenicsrom.scene.keys.excitation import highest_frequency

ONLINE_TABLES = (
    "title",
    "reference",
    "output",
    "compare",
    "campbell",
    "map",
    "damping",
    "response",
    "backbone",
    "statics",
    "loads",
    "contacts",
    "time",
)
"""Keys and tables that do not matter as such; `modes_table` and `model_table` add their parts."""


def modes_table(scene: Scene) -> dict[str, Any]:
    """The values, without the mesh file, on which mesh, equilibrium and component modes depend."""
    table = {name: value for name, value in scene_table(scene).items() if name not in ONLINE_TABLES}
    table["material"] = {**table["material"], "mass_damping": None}
    table["basis"] = {
        k: v for k, v in table["basis"].items() if k in ("method", "modes", "masters")
    }
    table["loads"] = [_shape(load) for load in scene.loads]
    table["contacts"] = [_frames(contact) for contact in scene.contacts]
    if scene.basis.modes == "auto":
        table["excitation"] = highest_frequency(scene)
    return table


def model_table(scene: Scene) -> dict[str, Any]:
    """The values on which the reduced model depends, besides `modes_table`.

    The linear transient, which selects modes and derivatives, depends on nearly all of the scene.
    """
    from fenicsrom.reduction.snapshots import transient_time

    basis = scene.basis
    table: dict[str, Any] = {
        "basis": {**plain(basis), "accuracy": None, "size": None},
        "damping": plain(scene.damping),
        "stresses": scene.output.stresses,
    }
    if scene.geometrically_nonlinear and basis.derivatives in BY_MOTION:
        whole = scene_table(scene)
        table |= {name: whole.get(name) for name in ("loads", "contacts", "material", "response")}
        if scene.backbone is not None and basis.derivatives == "principal":
            table["backbone"] = (scene.backbone.mode, scene.backbone.last)
        table["time"] = plain(transient_time(scene))
        table["excitation"] = highest_frequency(scene)
    return table


def motion_table(scene: Scene) -> dict[str, Any]:
    """The values on which the motion depends, besides `modes_table` and `model_table`."""
    whole = scene_table(scene)
    return {name: whole.get(name) for name in ("loads", "contacts", "material", "time", "basis")}


def keys_of(scene: Scene) -> tuple[str, str, str] | None:
    """The hashes of `modes_table`, with `model_table`, and with `motion_table`.

    None if the mesh file reads other files.

    Raises:
        OSError: the mesh file cannot be read.
    """
    mesh = mesh_digest(scene.geometry.mesh)
    if mesh is None:
        return None
    modes = modes_table(scene)
    modes["geometry"] = {**modes["geometry"], "mesh": mesh}
    modes["suffix"] = scene.geometry.mesh.suffix
    model = model_table(scene)
    return key_of(modes), key_of([modes, model]), key_of([modes, model, motion_table(scene)])


def _shape(load: Load) -> Any:
    """The values on which a unit load depends; all values of a load that deforms the body."""
    if load.static:
        return plain(load)
    without_size = {**plain(load.action), load.kind: None}
    return {**(plain(load.place) or {}), **without_size, "varies": True}


def _frames(contact: Contact) -> dict[str, Any]:
    """The keys of a contact on which its points and their frames depend."""
    table = _without(plain(contact), Contact, CONTACT_KEYS)
    if contact.surface is not None:
        table["surface"] = _without(table["surface"], Surface, SURFACE_KEYS)
    return table


def _without(table: dict[str, Any], kind: type, kept: tuple[str, ...]) -> dict[str, Any]:
    """A table without the fields of a dataclass, except the fields to keep."""
    dropped = {field.name for field in fields(kind)} - set(kept)
    return {name: value for name, value in table.items() if name not in dropped}
