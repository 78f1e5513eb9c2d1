"""The online stage: from a scene and a reduced model to a motion, without mesh and without dolfinx.

A reduced model is stored in one `.npz` file with its labels, units, provenance and the scene it was made from. What the
online stage may change is the size, frequency and phase of the harmonic loads, the damping, everything about the contacts
but where they are, and the time integration.
"""

from __future__ import annotations

import json
import zipfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fenicsrom.contact import Contacts
from fenicsrom.errors import SceneError
from fenicsrom.files import whole
from fenicsrom.integrate import Motion, integrate
from fenicsrom.reduced import ElasticPolynomial, ReducedModel, Signals, reduced_model
from fenicsrom.scene import Scene, override_table, parse_scene, scene_table

Array = NDArray[np.float64]

FORMAT = "fenicsrom reduced model 1"
UNITS = {"mass": "kg", "stiffness": "N/m", "quadratic": "N/m^2", "cubic": "N/m^3", "force": "N", "frequencies_hz": "Hz"}


def contacts(scene: Scene) -> Contacts:
    """The parameters of a scene's contact points."""
    return Contacts(*(np.array([getattr(c, name) for c in scene.contacts], dtype=np.float64) for name in Contacts._fields))


def signals(scene: Scene) -> Signals:
    """The time factors of a scene's loads."""
    return Signals(*(np.array(values, dtype=np.float64) for values in scene.signals))


def simulate(
    model: Any,
    scene: Scene,
    *,
    keep_coordinates: bool = False,
    progress: Callable[[float, float], None] | None = None,
) -> Motion:
    """Integrate a model of a scene (reduced, full or beam) as its [time] table says.

    Raises:
        ConvergenceError: see `fenicsrom.integrate.integrate`.
    """
    return integrate(
        model,
        contacts(scene),
        scene.time,
        scene.period,
        dimension=scene.geometry.dimension,
        keep_coordinates=keep_coordinates,
        progress=progress,
    )


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


def provenance(modules: Sequence[str] = ("numpy", "numba", "fenics-dolfinx", "petsc4py", "slepc4py")) -> dict[str, str]:
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
    with whole(path) as temporary, open(temporary, "wb") as file:
        np.savez(
            file,
            header=np.array(json.dumps(header)),
            frequencies_hz=stored.frequencies_hz,
            mass=model.mass,
            damping=np.array(model.damping),
            **model.elastic._asdict(),
            loads=model.loads,
            contact_offset=model.contact_offset,
            probe=model.probe,
            probe_offset=model.probe_offset,
        )


def load_model(path: Path) -> StoredModel:
    """Read a reduced model.

    Raises:
        SceneError: the file is missing, damaged, of another format, or its arrays do not fit together.
    """
    try:
        with open(path, "rb") as raw, np.load(raw, allow_pickle=False) as file:
            data = {name: np.array(file[name]) for name in file.files}
        header = json.loads(str(data["header"][()]))
        if header.get("format") != FORMAT:
            raise SceneError(f"{path}: format = {header.get('format')!r}: must be {FORMAT!r}")
        scene = parse_scene(header["scene"], str(header["source"]), None)
        labels = tuple(str(label) for label in header["labels"])
        stored = _assemble(path, data, header, scene, labels)
    except FileNotFoundError:
        raise SceneError(f"{path}: cannot be read: no such file") from None
    except OSError as error:
        raise SceneError(f"{path}: cannot be read: {error.strerror or error}") from None
    except SceneError:
        raise
    except (zipfile.BadZipFile, EOFError, KeyError, ValueError, TypeError, AttributeError, RecursionError, IndexError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise SceneError(f"{path}: is not a reduced model written by this program ({reason})") from None
    return stored


def _assemble(path: Path, data: dict[str, Any], header: dict[str, Any], scene: Scene, labels: tuple[str, ...]) -> StoredModel:
    n, d = len(labels), scene.geometry.dimension
    p = n * (n + 1) // 2 if scene.geometrically_nonlinear else 0
    shapes = {
        "mass": (n, n),
        "damping": (),
        "force": (n,),
        "stiffness": (n, n),
        "quadratic": (p, n if p else 0),
        "cubic": (p, p),
        "loads": (n, len(scene.loads)),
        "contact_offset": (len(scene.contacts) * d,),
        "probe": (d, n),
        "probe_offset": (d,),
        "frequencies_hz": data["frequencies_hz"].shape[:1],
    }
    for name, shape in shapes.items():
        array = data[name]
        if array.shape != shape or array.dtype != np.float64 or not np.all(np.isfinite(array)):
            raise SceneError(f"{path}: {name} has shape {array.shape} and type {array.dtype}: must be {shape} of finite float64")
    elastic = ElasticPolynomial(*(data[name] for name in ElasticPolynomial._fields))
    model = reduced_model(
        data["mass"], float(data["damping"]), elastic, data["loads"], signals(scene),
        data["contact_offset"], data["probe"], data["probe_offset"],
    )  # fmt: skip
    made_by = {str(k): str(v) for k, v in header["provenance"].items()}
    return StoredModel(model, scene, str(header["method"]), labels, int(header["dofs"]), data["frequencies_hz"], made_by)


def rescene(stored: StoredModel, overrides: Sequence[str]) -> tuple[ReducedModel, Scene]:
    """The stored model under another load, frequency, friction, damping or time integration.

    Args:
        stored: the model.
        overrides: as for `fenicsrom.scene.read_scene`, such as "loads.0.force=200".

    Returns:
        The model with its new time factors, and the new scene.

    Raises:
        SceneError: an override is wrong, or changes what the model was built from.
    """
    table = scene_table(stored.scene)
    named = {override.partition("=")[0].strip() for override in overrides}
    for given, other in (("time.tolerance", "steps_per_period"), ("time.steps_per_period", "tolerance")):
        if given in named:  # the table holds every default; one of the two excludes the other
            table["time"] = {key: value for key, value in table["time"].items() if key != other}
    scene = parse_scene(override_table(table, overrides, stored.scene.source), stored.scene.source, None)
    if (key := changed_key(stored.scene, scene)) is not None:
        raise SceneError(f"{scene.source}: {key} cannot change on a stored reduced model: run the scene again")
    return with_scene(stored, scene)


def with_scene(stored: StoredModel, scene: Scene) -> tuple[ReducedModel, Scene]:
    """The stored model with the time factors and damping of a scene that agrees with its own (`changed_key` is None)."""
    return stored.model._replace(signals=signals(scene), damping=float(scene.material.mass_damping)), scene


def changed_key(made: Scene, wanted: Scene) -> str | None:
    """The first key of the offline stage in which two scenes differ, None if they agree."""
    for name in ("geometrically_nonlinear", "geometry", "supports", "probe", "basis"):
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
            if kind == "loads" and a.direction != b.direction:
                return f"loads[{k}].direction"
            if kind == "loads" and (a.frequency is None or b.frequency is None) and a != b:
                return f"loads[{k}]: a static load"
    return None
