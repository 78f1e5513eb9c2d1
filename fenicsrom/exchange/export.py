"""Reduced models in the formats of other programs (`fenicsrom export`).

    mat     everything, the nonlinear elastic force included, for MATLAB and Octave
    fmu     everything, as a Functional Mock-up Unit for model exchange
    dmig    the linear part: mass, stiffness, damping and interface rows, as Nastran entries
    op4     the same as matrices in an OUTPUT4 text file

The interface rows give, from the coordinates q, the displacements of the contact points and of the
probe in global axes, and then for each load the displacement on which a unit of the load does work.
The scene beside the file names them, so that `fenicsrom import` makes a model of the linear part.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.errors import ErrorKind, refuse
from fenicsrom.exchange.fmu import write_fmu
from fenicsrom.exchange.matrix_set import DAMPING, INTERFACE, MASS, STIFFNESS, write_mat
from fenicsrom.exchange.nastran import write_dmig
from fenicsrom.exchange.op4 import write_op4
from fenicsrom.files import atomic_write
from fenicsrom.online.contact.points import shares
from fenicsrom.online.model.matrices import ModelArrays, model_arrays
from fenicsrom.online.store.archive import StoredModel
from fenicsrom.scene import scene_table, toml_text
from fenicsrom.scene.base.tables import plain
from fenicsrom.scene.checks.contact_checks import require_no_pairs
from fenicsrom.scene.keys.contacts import surface_spin
from fenicsrom.scene.reading.superelement import EXCLUDED

SUFFIXES: Mapping[str, str] = {"mat": ".mat", "fmu": ".fmu", "dmig": ".bdf", "op4": ".op4"}
"""Suffix of the file of each format."""

CURVES = ("response", "backbone")
"""Tables that may name loads by their numbers, which change with the static loads left out."""

NOT_COPIED = (
    *(*EXCLUDED, *CURVES, "damping", "supports", "loads", "contacts", "probe", "output"),
    *("title", "units", "source", "geometrically_nonlinear"),
)
"""What the scene of the exported file has in another form, or not at all."""
PLACE_KEYS = ("group", "box", "plane", "node", "nearest", "at")


HEADING = "# The linear part of a reduced model, exported to "
"""The scene beside an exported file begins so."""


@dataclass(frozen=True, eq=False)
class Exported:
    """The files of an export.

    Attributes:
        files: the written files.
        notes: sentences on what the files leave out.
    """

    files: tuple[Path, ...]
    notes: tuple[str, ...]


def export(stored: StoredModel, path: Path, form: str) -> Exported:
    """Write a reduced model for another program.

    Args:
        stored: the model; it is written with the `basis.size` of its scene, if that gives one.
        path: the file to write.
        form: a key of `SUFFIXES`.

    Raises:
        SceneError: a follower pressure acts on the model, it has contacts between bodies, or
            another scene would be replaced.
        OSError: a file cannot be written.
    """
    require_no_pairs(stored.scene)
    scene = path.with_suffix(".toml")
    if form != "fmu":
        _require_own(scene)
    stored = stored.resized(stored.scene.basis.size or stored.size)
    arrays, linear = model_arrays(stored.model, stored.scene.source), stored.model.linear
    if form == "fmu":
        compiled = write_fmu(path, stored, arrays)
        note = "no C compiler was found, so the unit holds only its source, sources/model.c"
        return Exported((path,), () if compiled else (note,))
    interface, nodes = interface_nodes(stored)
    if form == "mat":
        write_mat(path, stored, arrays, interface)
    elif form == "op4":
        write_op4(path, linear_matrices(arrays, interface))
    else:
        write_dmig(path, linear_matrices(arrays, interface), stored.size)
    with atomic_write(scene) as temporary:
        temporary.write_text(import_scene(stored, nodes, path.name), encoding="utf-8")
    notes = []
    if any(load.moves_supports for load in stored.scene.loads):
        notes.append(
            "the motion of the supports is exported as the force of its inertia at the frequency "
            "of the scene: do not change this frequency"
        )
    if not linear and form != "mat":
        notes.append("the file holds the linear part of the model; mat holds all of it")
    return Exported((path, scene), tuple(notes))


def _require_own(scene: Path) -> None:
    """Refuse to replace a scene that an export did not write."""
    if scene.exists() and not scene.read_bytes().startswith(HEADING.encode()):
        reason = "would be replaced by the scene of the exported file; give the file another name"
        raise refuse(scene, reason, ErrorKind.FILE, "--output")


def linear_matrices(arrays: ModelArrays, interface: Array) -> dict[str, Array]:
    """The matrices of the linear part by their names in Nastran files.

    Args:
        arrays: the arrays of the model.
        interface: (r, n) rows of the interface displacements.
    """
    damping = arrays.damping + arrays.gyroscopic
    found = {STIFFNESS: _symmetric(arrays.stiffness), MASS: _symmetric(arrays.mass)}
    if np.any(damping):
        found[DAMPING] = damping
    if len(interface):
        found[INTERFACE] = interface.T
    return found


def _symmetric(matrix: Array) -> Array:
    """The symmetric part, which differs by round-off."""
    return np.asarray(0.5 * (matrix + matrix.T))


def interface_nodes(stored: StoredModel) -> tuple[Array, list[dict[str, Any]]]:
    """The interface rows (r, n) of a model, and its interface nodes as tables of a scene."""
    model, d = stored.model, stored.scene.geometry.dimension
    points, area = model.points, shares(stored.scene, model.points)
    rows: list[Array] = []
    nodes: list[dict[str, Any]] = []

    def add(name: str, block: Array, position: Array, offset: Array, area: float = 1.0) -> None:
        first = sum(map(len, rows)) + 1
        rows.append(block)
        table = {"name": name, "position": position.tolist()}
        table["coordinates"] = [*range(first, first + len(block)), *[0] * (d - len(block))]
        if np.any(offset):
            table["offset"] = offset.tolist()
        nodes.append({**table, **({"area": area} if area != 1.0 else {})})

    for p, number in enumerate(points.contact):
        mine, axes = slice(p * d, (p + 1) * d), points.frame[p].T
        seen, offset = axes @ model.contact_rows[mine], axes @ model.contact_offset[mine]
        add(f"contact {number + 1}", seen, points.position[p], offset, float(area[p]))
    if len(model.probe):
        add("probe", model.probe, np.zeros(d), model.probe_offset)
    for k, load in enumerate(stored.scene.loads):
        if not load.static:
            add(f"load {k + 1}", model.loads[:, k][None, :], np.zeros(d), np.zeros(d))
    return np.concatenate([*rows, np.zeros((0, model.size))]), nodes


def import_scene(stored: StoredModel, nodes: list[dict[str, Any]], name: str) -> str:
    """The scene with which `fenicsrom import` makes a model of the exported matrices, as TOML.

    The static loads are left out: the matrices are those at the equilibrium under these loads.
    """
    scene, table = stored.scene, scene_table(stored.scene)
    d = scene.geometry.dimension
    along = [1.0, *[0.0] * (d - 1)]
    found: dict[str, Any] = {"title": scene.title, "superelement": {"dimension": d}, "nodes": nodes}
    loads = []
    for k, load in enumerate(entry.by_acceleration() for entry in scene.loads):
        if not load.static:
            place = {"group": f"load {k + 1}", "direction": along, "force": load.size}
            loads.append({**place, **plain(load.history)})
    contacts = []
    for k, (contact, given) in enumerate(zip(scene.contacts, table["contacts"], strict=True)):
        kept = {key: value for key, value in given.items() if key not in PLACE_KEYS}
        if contact.surface is not None and contact.surface.kind == "cylinder":
            kept["surface"] = {
                **given["surface"],
                "spin": surface_spin(contact.surface, scene.rotation),
            }
        at = {"at": "nodes"} if contact.place.at == "nodes" else {}
        contacts.append({"group": f"contact {k + 1}", **at, **kept})
    found |= {"loads": loads} if loads else {}
    found |= {"contacts": contacts} if contacts else {}
    found |= {"probe": {"group": "probe"}} if len(stored.model.probe) else {}
    found |= {key: value for key, value in table.items() if key not in NOT_COPIED}
    lines = [
        f"{HEADING}{name}. To make a model of it:",
        f"#     fenicsrom import {name} --scene {Path(name).with_suffix('.toml').name}",
        "# The place of the probe is not known; a load acts along the row that belongs to it.",
    ]
    return "\n".join([*lines, "", toml_text(found)])
