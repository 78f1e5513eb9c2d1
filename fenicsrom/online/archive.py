"""The online stage: from a scene and a reduced model to a motion, without mesh and without dolfinx.

A reduced model is stored in one `.npz` file with its labels, units, provenance and the scene it was
made from. What the online stage may change is the size of the loads that are not static and how
they vary in time, the damping, everything about the contacts but where they are, and the time
integration.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.errors import ErrorKind, SceneError
from fenicsrom.files import read_archive, write_archive
from fenicsrom.online.contact_points import ContactPoints
from fenicsrom.online.model import ReducedModel, reduced_model
from fenicsrom.online.polynomial import ElasticPolynomial
from fenicsrom.online.simulate import load_histories
from fenicsrom.scene import Scene, override_table, parse_scene, scene_table

FORMAT = "fenicsrom reduced model 3"
UNITS = {
    "mass": "kg",
    "stiffness": "N/m",
    "quadratic": "N/m^2",
    "cubic": "N/m^3",
    "force": "N",
    "frequencies_hz": "Hz",
}


@dataclass(frozen=True, eq=False)
class StoredModel:
    """A reduced model as a file holds it.

    Attributes:
        model: the model.
        scene: the scene it was made from.
        method: "rubin" or "craig-bampton".
        labels: (n,) of its coordinates.
        dofs: number of free unknowns of the solid.
        frequencies_hz: (v,) of the normal modes.
        provenance: versions of the programs that made it, by name.
    """

    model: ReducedModel
    scene: Scene
    method: str
    labels: tuple[str, ...]
    dofs: int
    frequencies_hz: Array
    provenance: dict[str, str]

    @property
    def size(self) -> int:
        """Number of coordinates."""
        return self.model.size


def provenance(
    modules: Sequence[str] = ("numpy", "numba", "fenics-dolfinx", "petsc4py", "slepc4py"),
) -> dict[str, str]:
    """Versions of this program and of what it stands on, where they are installed."""
    found = {}
    for name in ("fenicsrom", *modules):
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found


def save_model(path: Path, stored: StoredModel) -> None:
    """Write a reduced model; the file appears whole or not at all.

    Raises:
        OSError: it cannot be written.
    """
    header = {
        "format": FORMAT,
        "method": stored.method,
        "labels": list(stored.labels),
        "dofs": stored.dofs,
        "source": stored.scene.source,
        "scene": scene_table(stored.scene),
        "units": UNITS,
        "provenance": stored.provenance,
    }
    model = stored.model
    arrays = {
        "frequencies_hz": stored.frequencies_hz,
        "mass": model.mass,
        "damping": np.array(model.damping),
        **model.elastic._asdict(),
        "loads": model.loads,
        **{f"point_{name}": array for name, array in model.points._asdict().items()},
        "contact_rows": model.contact_rows,
        "contact_offset": model.contact_offset,
        "probe": model.probe,
        "probe_offset": model.probe_offset,
        "gyroscopic_matrix": model.gyroscopic_matrix,
    }
    write_archive(path, header, arrays)


def load_model(path: Path) -> StoredModel:
    """Read a reduced model.

    Raises:
        SceneError: the file is missing, damaged, of another format, or its arrays do not fit
            together.
    """
    with read_archive(path, "a reduced model", FORMAT) as (header, data):
        scene = parse_scene(header["scene"], str(header["source"]), None)
        labels = tuple(str(label) for label in header["labels"])
        return _assemble(path, data, header, scene, labels)


def _assemble(
    path: Path, data: dict[str, Any], header: dict[str, Any], scene: Scene, labels: tuple[str, ...]
) -> StoredModel:
    n, d = len(labels), scene.geometry.dimension
    p = n * (n + 1) // 2 if scene.geometrically_nonlinear else 0
    belongs = data["point_contact"]
    if (
        belongs.ndim != 1
        or belongs.dtype != np.int64
        or not np.array_equal(np.unique(belongs), np.arange(len(scene.contacts)))
    ):
        raise SceneError(
            f"{path}: point_contact does not name the contacts of the scene: the file is damaged",
            kind=ErrorKind.FORMAT,
            source=str(path),
        )
    points = belongs.size
    shapes = {
        "mass": (n, n),
        "damping": (),
        "force": (n,),
        "stiffness": (n, n),
        "quadratic": (p, n if p else 0),
        "cubic": (p, p),
        "loads": (n, len(scene.loads)),
        "point_tributary_area": (points,),
        "point_position": (points, d),
        "point_frame": (points, d, d),
        "contact_rows": (points * d, n),
        "contact_offset": (points * d,),
        "probe": (d, n),
        "probe_offset": (d,),
        "gyroscopic_matrix": (n, n)
        if scene.rotation is not None and scene.rotation.coriolis
        else (0, 0),
        "frequencies_hz": (data["frequencies_hz"].size,),
    }
    for name, shape in shapes.items():
        array = data[name]
        if array.shape != shape or array.dtype != np.float64 or not np.all(np.isfinite(array)):
            raise SceneError(
                f"{path}: {name} has shape {array.shape} and type {array.dtype}: must be {shape} of finite float64",
                kind=ErrorKind.FORMAT,
                source=str(path),
            )
    for name in ("mass", "stiffness"):
        if np.max(np.abs(data[name] - data[name].T), initial=0.0) > 1e-9 * np.max(
            np.abs(data[name]), initial=0.0
        ):
            raise SceneError(
                f"{path}: {name} is not symmetric: the file is damaged",
                kind=ErrorKind.FORMAT,
                source=str(path),
            )
    gyroscopic_matrix = data["gyroscopic_matrix"]
    if np.max(np.abs(gyroscopic_matrix + gyroscopic_matrix.T), initial=0.0) > 1e-9 * np.max(
        np.abs(gyroscopic_matrix), initial=0.0
    ):
        raise SceneError(
            f"{path}: gyroscopic_matrix is not skew: the file is damaged",
            kind=ErrorKind.FORMAT,
            source=str(path),
        )
    if not (np.all(np.linalg.eigvalsh(data["mass"]) > 0.0) and data["damping"] >= 0.0):
        raise SceneError(
            f"{path}: mass or damping is not positive: the file is damaged",
            kind=ErrorKind.FORMAT,
            source=str(path),
        )
    elastic = ElasticPolynomial(*(data[name] for name in ElasticPolynomial._fields))
    model = reduced_model(
        data["mass"],
        float(data["damping"]),
        elastic,
        data["loads"],
        load_histories(scene),
        ContactPoints(*(data[f"point_{name}"] for name in ContactPoints._fields)),
        data["contact_rows"],
        data["contact_offset"],
        data["probe"],
        data["probe_offset"],
        data["gyroscopic_matrix"],
    )
    made_by = {str(k): str(v) for k, v in header["provenance"].items()}
    return StoredModel(
        model,
        scene,
        str(header["method"]),
        labels,
        int(header["dofs"]),
        data["frequencies_hz"],
        made_by,
    )


def rescene(stored: StoredModel, overrides: Sequence[str]) -> tuple[ReducedModel, Scene]:
    """The stored model under another load, frequency, friction, damping or time integration.

    Args:
        stored: the model.
        overrides: as for `fenicsrom.scene.schema.read_scene`, such as "loads.0.force=200".

    Returns:
        The model with its new time factors, and the new scene.

    Raises:
        SceneError: an override is wrong, or changes what the model was built from.
    """
    table = scene_table(stored.scene)
    named = {override.partition("=")[0].strip() for override in overrides}
    for given, other in (
        ("time.tolerance", "steps_per_period"),
        ("time.steps_per_period", "tolerance"),
    ):
        if given in named:  # the table holds every default; one of the two excludes the other
            table["time"] = {key: value for key, value in table["time"].items() if key != other}
    scene = parse_scene(
        override_table(table, overrides, stored.scene.source), stored.scene.source, None
    )
    if (key := changed_key(stored.scene, scene)) is not None:
        raise SceneError(
            f"{scene.source}: {key} cannot change on a stored reduced model: run the scene again"
        )
    return with_scene(stored, scene)


def with_scene(stored: StoredModel, scene: Scene) -> tuple[ReducedModel, Scene]:
    """The stored model with the time factors and damping of a scene that agrees with its own
    (`changed_key` is None).
    """
    return stored.model._replace(
        load_histories=load_histories(scene), damping=float(scene.material.mass_damping)
    ), scene


def changed_key(made: Scene, wanted: Scene) -> str | None:
    """The first key of the offline stage in which two scenes differ, None if they agree."""
    for name in ("geometrically_nonlinear", "geometry", "supports", "rotation", "probe", "basis"):
        if getattr(made, name) != getattr(wanted, name):
            return name
    if replace(made.material, mass_damping=0.0) != replace(wanted.material, mass_damping=0.0):
        return "material"
    for kind in ("loads", "contacts"):
        ours, theirs = getattr(made, kind), getattr(wanted, kind)
        if len(ours) != len(theirs):
            return kind
        for k, (a, b) in enumerate(zip(ours, theirs, strict=True)):
            if a.place != b.place:
                return f"{kind}[{k}].place"
            if kind == "contacts" and a.normal != b.normal:
                return f"contacts[{k}].normal"
            if kind == "contacts" and a.surface is not None:
                for name in (
                    "kind",
                    "point",
                    "axis",
                    "inside",
                ):  # the frames of the points are those of its normals
                    if getattr(a.surface, name) != getattr(b.surface, name):
                        return f"contacts[{k}].surface.{name}"
            if kind == "loads" and a.direction != b.direction:
                return f"loads[{k}].direction"
            if kind == "loads" and a.kind != b.kind:
                return f"loads[{k}].{b.kind}"
            if kind == "loads" and (a.static or b.static) and a != b:
                return f"loads[{k}]: a static load"
    return None
