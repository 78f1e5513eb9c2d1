"""Mesh and geometry files in gmsh: .geo, .msh and .step, and through meshio .inp, .bdf and .vtu."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np

from fenicsrom.errors import ErrorKind, SceneError
from fenicsrom.fem import formats
from fenicsrom.fem.gmsh_queries import Ints
from fenicsrom.scene import Geometry

FARTHEST = 1e15
"""Larger coordinates, in the unit of the file, may make gmsh crash or fill all memory."""

MOST_CELLS = 1e5
"""Largest number of cells along the body."""

SUFFIXES = {
    ".geo": "geo",
    ".msh": "msh",
    ".step": "step",
    ".stp": "step",
    ".inp": "abaqus",
    ".bdf": "nastran",
    ".nas": "nastran",
    ".vtu": "vtu",
}
"""Formats by the suffix of the file."""

_READ = """
import sys, gmsh
gmsh.initialize(readConfigFiles=False, interruptible=False)
gmsh.option.setNumber("General.Terminal", 0)
gmsh.option.setNumber("General.AbortOnError", 0)
try:
    gmsh.model.add("file")
    gmsh.merge(sys.argv[1])
    gmsh.model.mesh.getNodes()
    for d, tag in gmsh.model.getEntities():
        for kind in gmsh.model.mesh.getElements(d, tag)[0]:
            gmsh.model.mesh.getElementProperties(kind)
    for d, tag in gmsh.model.getPhysicalGroups():
        gmsh.model.getEntitiesForPhysicalGroup(d, tag)
except Exception:
    pass
gmsh.finalize()
"""
"""A script that reads a file as this program does; it only shows whether gmsh crashes."""


@contextmanager
def open_gmsh() -> Iterator[Any]:
    """Open gmsh for the duration of a context.

    It prints nothing, ignores the settings of the user and leaves interrupts to Python.

    Raises:
        RuntimeError: gmsh is in use in this process.
    """
    import gmsh

    if gmsh.isInitialized():
        raise RuntimeError(
            "gmsh is in use in this process: call gmsh.finalize() before you build a mesh"
        )
    gmsh.initialize(readConfigFiles=False, interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        # errors go to the logger, because an abort breaks the parser of gmsh
        gmsh.option.setNumber("General.AbortOnError", 0)
        # without this, the tolerances are relative to the last model of this process
        gmsh.open(os.devnull)
        gmsh.logger.start()
        yield gmsh
    finally:
        gmsh.logger.stop()
        gmsh.finalize()


def load_file(gmsh: Any, geometry: Geometry) -> dict[str, Ints]:
    """Read the file and, if it is a geometry, mesh it; give the node numbers of its node sets.

    Raises:
        SceneError: the file cannot be read or meshed.
    """
    source, d, form = (
        str(geometry.mesh),
        geometry.dimension,
        SUFFIXES.get(geometry.mesh.suffix.lower()),
    )
    if not geometry.mesh.is_file() or form is None:
        raise SceneError(
            f"geometry.mesh = {source!r}: must be an existing file of one of {', '.join(SUFFIXES)}",
            kind=ErrorKind.FILE,
            key="geometry.mesh",
            source=source,
        )
    gmsh.model.add("file")
    if form == "geo":
        _set_parameters(gmsh, geometry)
    sets = {}
    with _errors(gmsh, source):
        if form in ("msh", "step"):
            _survive(source)
        if form in ("geo", "msh"):
            gmsh.merge(source)
        elif form == "step":
            gmsh.option.setString("Geometry.OCCTargetUnit", "M")
            gmsh.model.occ.importShapes(source)
            gmsh.model.occ.synchronize()
        else:
            sets = _import(gmsh, geometry.mesh, form, geometry.curved)
    if form in ("geo", "step"):
        _check_reach(gmsh, geometry)
    if gmsh.model.getDimension() != d:
        raise SceneError(
            f"{source}: geometry.dimension = {d}: must be {gmsh.model.getDimension()} "
            "for this file",
            kind=ErrorKind.CONFLICT,
            key="geometry.dimension",
            source=source,
        )
    if form == "step":
        _name_faces(gmsh, d)
        for limit in ("Min", "Max"):
            gmsh.option.setNumber(f"Mesh.MeshSize{limit}", geometry.size)
    if form in ("geo", "step"):
        with _errors(gmsh, source):
            gmsh.model.mesh.generate(d)
            if geometry.curved:
                gmsh.model.mesh.setOrder(2)
    return sets


def _check_reach(gmsh: Any, geometry: Geometry) -> None:
    """Check the extent of a geometry, because gmsh could crash or fill all memory.

    Raises:
        SceneError: the body has no extent, extends too far, or needs too many cells.
    """
    source, places = (
        str(geometry.mesh),
        [gmsh.model.getValue(0, tag, []) for _, tag in gmsh.model.getEntities(0)],
    )
    with suppress(Exception):  # a plain exception of gmsh: the box is empty
        places += np.reshape(gmsh.model.getBoundingBox(-1, -1), (2, 3)).tolist()
    wrong = [place for place in places if not np.all(np.abs(place) <= FARTHEST)]
    if wrong:
        where = ", ".join(f"{value:.6g}" for value in wrong[0])
        raise SceneError(
            f"{source}: the geometry extends to ({where}), but coordinates must be at most "
            f"{FARTHEST:g}",
            kind=ErrorKind.MESH,
            source=source,
        )
    extent = float(np.ptp(places or np.zeros((1, 3)), axis=0).max())
    if extent == 0.0:
        raise SceneError(
            f"{source}: the geometry has no body with an extent", kind=ErrorKind.MESH, source=source
        )
    if geometry.size is not None and geometry.size * MOST_CELLS < extent:
        allowed = f"must be at least {extent / MOST_CELLS:.3g} for a body of {extent:.3g} m"
        raise SceneError(
            f"{source}: geometry.size = {geometry.size:g}: {allowed}",
            kind=ErrorKind.RANGE,
            key="geometry.size",
            source=source,
        )


def _survive(source: str) -> None:
    """Read a .msh or .step file in another process first.

    A damaged file can crash gmsh, or gmsh may never finish reading it.

    Raises:
        SceneError: gmsh crashed or did not finish.
    """
    seconds = 60.0 + 1e-6 * Path(source).stat().st_size
    try:
        code = subprocess.run(
            [sys.executable, "-c", _READ, source],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            timeout=seconds,
            check=False,
        ).returncode
    except subprocess.TimeoutExpired:
        raise SceneError(
            f"{source}: gmsh did not finish reading the file within {seconds:.0f} s; "
            "it may be damaged",
            kind=ErrorKind.FORMAT,
            source=source,
        ) from None
    if code:
        raise SceneError(
            f"{source}: gmsh crashed while reading the file; it is damaged",
            kind=ErrorKind.FORMAT,
            source=source,
        )


def _set_parameters(gmsh: Any, geometry: Geometry) -> None:
    """Set the parameters in gmsh, by their names in the .geo file.

    Raises:
        SceneError: the file does not define a parameter.
    """
    known = _parameters(geometry.mesh)
    if "structured" in known:
        gmsh.parser.setNumber("structured", [float(geometry.cells != "simplex")])
    for name, value in geometry.parameters.items():
        if name not in known - {"structured"}:
            allowed = (
                ", ".join(sorted(known - {"structured"}))
                or "none, as the file has no DefineConstant"
            )
            raise SceneError(
                f"{geometry.mesh}: geometry.parameters.{name} = {value:g}: name must be one of "
                f"{allowed}",
                kind=ErrorKind.UNKNOWN_KEY,
                key=f"geometry.parameters.{name}",
                source=str(geometry.mesh),
            )
        gmsh.parser.setNumber(name, [value])


def _name_faces(gmsh: Any, d: int) -> None:
    """Make a group of each face of a .step file, named by its name or else its number."""
    faces: dict[str, list[int]] = {}
    for _, face in gmsh.model.getEntities(d - 1):
        faces.setdefault(
            gmsh.model.getEntityName(d - 1, face).rpartition("/")[2] or str(face), []
        ).append(face)
    for name, members in faces.items():
        gmsh.model.addPhysicalGroup(d - 1, members, name=name)


def _import(gmsh: Any, path: Path, form: str, curved: bool) -> dict[str, Ints]:
    """Read a file with meshio into gmsh, and give the node numbers of each node set."""
    file = formats.read(path, form, curved)
    dimensions = [gmsh.model.mesh.getElementProperties(kind)[1] for kind, _ in file.blocks]
    gmsh.model.addDiscreteEntity(max(dimensions), 1)
    gmsh.model.mesh.addNodes(
        max(dimensions), 1, np.arange(len(file.points)) + 1, file.points.ravel()
    )
    entities: dict[tuple[int, str], list[int]] = {}
    for index, ((kind, cells), d) in enumerate(zip(file.blocks, dimensions, strict=True)):
        member = np.array([marks[index] for marks in file.groups.values()], dtype=bool)
        kinds, which = np.unique(
            member.reshape(len(file.groups), len(cells)).T, axis=0, return_inverse=True
        )
        for k, marks in enumerate(kinds):
            entity = gmsh.model.addDiscreteEntity(d)
            gmsh.model.mesh.addElementsByType(
                entity, kind, [], (cells[which.ravel() == k] + 1).ravel()
            )
            for name in (name for name, marked in zip(file.groups, marks, strict=True) if marked):
                entities.setdefault((d, name), []).append(entity)
    # one call per name, because gmsh leaves a second group of this name unnamed
    for (d, name), members in entities.items():
        gmsh.model.addPhysicalGroup(d, members, name=name)
    return {name: nodes + 1 for name, nodes in file.nodes.items()}


@contextmanager
def _errors(gmsh: Any, source: str) -> Iterator[None]:
    """Raise the first error in the log of gmsh, which does not raise all of its errors.

    Raises:
        SceneError: gmsh reported an error.
    """
    failure = None
    try:
        yield
    except SceneError:
        raise
    except Exception as error:  # gmsh raises plain exceptions
        failure = error
    errors = [line.partition(":")[2] for line in gmsh.logger.get() if line.startswith("Error")]
    if errors or failure is not None:
        sentence = " ".join((errors or [str(failure)])[0].split())
        parameter = re.match(
            r"(geometry\.parameters\.\w+) = ", sentence
        )  # by Error() in a .geo file
        raise SceneError(
            f"{source}: {sentence}",
            kind=ErrorKind.RANGE if parameter else ErrorKind.MESH,
            key=parameter[1] if parameter else "",
            source=source,
        ) from failure


def _parameters(path: Path) -> set[str]:
    """Names of the parameters in the DefineConstant blocks of a .geo file."""
    text = re.sub(
        r'"[^"\n]*"|//[^\n]*|/\*.*?\*/', "", path.read_text(errors="replace"), flags=re.DOTALL
    )
    while (inner := re.sub(r"\{[^{}]*\}", "", text)) != text:
        text = inner
    blocks = re.findall(r"\bDefineConstant\s*\[([^]]*)\]", text)
    return {entry.partition("=")[0].strip() for block in blocks for entry in block.split(",")} - {
        ""
    }
