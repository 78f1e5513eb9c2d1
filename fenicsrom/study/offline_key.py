"""Hashes of all that decides the offline results of a scene: the names of cache entries.

The hashes cover the scene with its defaults, without the keys that do not matter; the content of
the mesh file; every module of this package; the versions of the libraries; the options of PETSc.
A key of the scene matters unless it is left out here.
"""

from __future__ import annotations

import hashlib
import json
import os
from dataclasses import fields
from typing import Any

from fenicsrom.files import reads_other_files
from fenicsrom.online.store.scene_changes import CONTACT_KEYS, SURFACE_KEYS
from fenicsrom.scene import Contact, Load, Scene, Surface, scene_table
from fenicsrom.scene.excitation import highest_frequency
from fenicsrom.scene.rules import BY_MOTION
from fenicsrom.scene.tables import plain

ONLINE_TABLES = (
    "title",
    "reference",
    "output",
    "compare",
    "campbell",
    "damping",
    "response",
    "backbone",
    "statics",
    "loads",
    "contacts",
    "time",
)
"""Keys and tables that do not matter as such; `modes_table` and `model_table` add their parts."""

LIBRARIES = (
    "numpy",
    "scipy",
    "numba",
    "gmsh",
    "meshio",
    "fenics-basix",
    "fenics-dolfinx",
    "petsc4py",
    "slepc4py",
)


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
        table["time"] = plain(transient_time(scene))
        table["excitation"] = highest_frequency(scene)
    return table


def keys_of(scene: Scene) -> tuple[str, str] | None:
    """The hashes of `modes_table` and of both tables; None if the mesh file reads other files."""
    content = scene.geometry.mesh.read_bytes()
    if reads_other_files(content):
        return None
    modes = modes_table(scene)
    modes["geometry"] = {**modes["geometry"], "mesh": hashlib.sha256(content).hexdigest()}
    modes["suffix"] = scene.geometry.mesh.suffix
    modes["program"] = _program()
    return _digest(modes), _digest([modes, model_table(scene)])


def _program() -> dict[str, str]:
    """The code of this package, the versions of the libraries, and the options of PETSc."""
    from fenicsrom.assess.full.full_cache import PACKAGE, package_digest
    from fenicsrom.online.store.provenance import provenance

    found = provenance(LIBRARIES)
    found["package"] = package_digest(PACKAGE)
    return found | {name: os.environ.get(name, "") for name in ("PETSC_OPTIONS", "OMP_NUM_THREADS")}


def _digest(table: Any) -> str:
    """SHA-256 of plain data."""
    return hashlib.sha256(json.dumps(table, sort_keys=True).encode()).hexdigest()


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
