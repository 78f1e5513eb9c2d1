"""Mesh and geometry files in gmsh: its own formats, and those that `fenicsrom.formats` reads.

A .geo file is a program that gmsh runs. Every other file is data: its header is checked before gmsh
sees it, because gmsh would run a script whatever the name of the file is. It would also run
a script that lies beside a file.
"""

import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from fenicsrom import formats
from fenicsrom.errors import ErrorKind, SceneError, refuse
from fenicsrom.fem.mesh.gmsh_cad import mesh_cad, model_nodes
from fenicsrom.formats import Block, MeshFile
from fenicsrom.formats.mesh_file import Ints, Physics
from fenicsrom.formats.shapes import SHAPES
from fenicsrom.notes import note_of
from fenicsrom.scene import Geometry
from fenicsrom.scene.base.rules import Where

HEADERS = {
    ".msh": rb"\$(MeshFormat|NOD|Comments)\b",
    ".unv": rb"\s*-1\s",
    ".step": rb"\s*(/\*.*?\*/\s*)*ISO-10303-21\s*;",
    ".stp": rb"\s*(/\*.*?\*/\s*)*ISO-10303-21\s*;",
}
"""Beginning of a data file that gmsh reads, by its suffix."""

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


def check_header(path: Path) -> None:
    """Check that a data file begins as its format does; gmsh would run a script.

    Raises:
        SceneError: the file begins otherwise.
    """
    with path.open("rb") as file:
        head = file.read(10_000)
    if not re.match(HEADERS[path.suffix.lower()], head, flags=re.DOTALL):
        reason = f"the file does not begin as a {path.suffix} file does; it may be damaged, or it "
        raise refuse(path, f"{reason}has the wrong suffix")


@contextmanager
def linked_alone(path: Path) -> Iterator[str]:
    """Give a link to a file in a folder of its own, because gmsh runs a script beside a file.

    The script that gmsh looks for has the name of the file and the suffix .opt.
    """
    with tempfile.TemporaryDirectory(prefix="fenicsrom-") as folder:
        link = Path(folder) / f"mesh{path.suffix}"
        try:
            link.symlink_to(path.resolve())
        except OSError:  # a system without links
            shutil.copyfile(path, link)
        yield str(link)


def check_survival(source: str, link: str) -> None:
    """Read a data file in another process first.

    A damaged file can crash gmsh, or gmsh may never finish reading it.

    Args:
        source: the file, for messages.
        link: the file that gmsh reads.

    Raises:
        SceneError: gmsh crashed or did not finish.
    """
    seconds = 60.0 + 1e-6 * Path(link).stat().st_size
    try:
        code = subprocess.run(
            [sys.executable, "-c", _READ, link],
            stdin=subprocess.DEVNULL,
            capture_output=True,
            timeout=seconds,
            check=False,
        ).returncode
    except subprocess.TimeoutExpired:
        reason = f"gmsh did not finish reading the file within {seconds:.0f} s; it may be damaged"
        raise refuse(source, reason) from None
    if code:
        raise refuse(source, "gmsh crashed while reading the file; it is damaged")


FARTHEST = 1e15
"""Larger coordinates, in the unit of the file, may make gmsh crash or fill all memory."""

MOST_CELLS = 2000
"""Largest number of cells along the body."""

SUFFIXES = {".geo": "geo", ".msh": "mesh", ".unv": "mesh", ".step": "step", ".stp": "step"}
"""Formats that gmsh reads, by the suffix of the file."""


@dataclass(frozen=True)
class Loaded:
    """The content of a file besides the model in gmsh.

    Attributes:
        node_sets: node numbers of each node set by its name.
        warnings: sentences for the user.
        physics: materials, supports, masses and loads of a finite-element model.
        glued: names of the faces of a CAD file along which bodies are glued.
    """

    node_sets: dict[str, Ints] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    physics: Physics = field(default_factory=Physics)
    glued: set[str] = field(default_factory=set)


@contextmanager
def open_gmsh() -> Iterator[Any]:
    """Open gmsh for the duration of a context.

    gmsh prints nothing, ignores the settings of the user and leaves interrupts to Python.

    Raises:
        RuntimeError: gmsh is in use in this process.
    """
    import gmsh

    if gmsh.isInitialized():
        raise RuntimeError("gmsh is in use: call gmsh.finalize() before you build a mesh")
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


def load_file(gmsh: Any, geometry: Geometry) -> Loaded:
    """Read the file and, if it is a geometry, mesh it.

    Raises:
        SceneError: the file cannot be read or meshed.
    """
    source, d = str(geometry.mesh), geometry.dimension
    form = SUFFIXES.get(geometry.mesh.suffix.lower())
    loaded = merge_file(gmsh, geometry)
    if (found := gmsh.model.getDimension()) != d:
        where = Where(source, "geometry.dimension")
        raise where.refuse(d, f"must be {found} for this file", ErrorKind.CONFLICT)
    if form == "step":
        glued, warnings = mesh_cad(gmsh, geometry)
        return replace(loaded, warnings=warnings, glued=glued)
    if form == "geo":
        with _errors(gmsh, source):
            gmsh.model.mesh.generate(d)
            if geometry.curved:
                gmsh.model.mesh.setOrder(2)
    return loaded


def merge_file(gmsh: Any, geometry: Geometry) -> Loaded:
    """Read the file into a new model of gmsh, without meshing a geometry.

    The dimension of the geometry is not used.

    Raises:
        SceneError: the file cannot be read.
    """
    source, suffix = str(geometry.mesh), geometry.mesh.suffix.lower()
    form = SUFFIXES.get(suffix)
    if not geometry.mesh.is_file():
        raise refuse(source, "cannot be read: no such file", ErrorKind.FILE, "geometry.mesh")
    if form is None and suffix not in formats.SUFFIXES:
        reason = f"must be a file of one of {', '.join((*SUFFIXES, *formats.SUFFIXES))}"
        raise refuse(source, reason, ErrorKind.FILE, "geometry.mesh")
    gmsh.model.add("file")
    if form is None:
        file = formats.read(geometry.mesh)
        return add_mesh(gmsh, source, formats.complete(file) if geometry.curved else file)
    if form == "geo":
        _set_parameters(gmsh, geometry)
        with _errors(gmsh, source):
            gmsh.merge(source)
        _check_reach(gmsh, geometry)
        return Loaded()
    check_header(geometry.mesh)
    with linked_alone(geometry.mesh) as link, _errors(gmsh, source, link):
        check_survival(source, link)
        if form == "mesh":
            gmsh.merge(link)
            _check_content(gmsh, source)
        else:
            gmsh.option.setString("Geometry.OCCTargetUnit", "M")
            gmsh.model.occ.importShapes(link)
            gmsh.model.occ.synchronize()
    if form == "step":
        _check_reach(gmsh, geometry)
    elif _has_several_shapes(gmsh):
        return add_mesh(gmsh, source, formats.divided(mesh_of_model(gmsh)))
    elif geometry.curved and _has_serendipity_cells(gmsh):
        return add_mesh(gmsh, source, formats.complete(mesh_of_model(gmsh)))
    return Loaded()


def _check_reach(gmsh: Any, geometry: Geometry) -> None:
    """Check the extent of a geometry, because gmsh could crash or fill all memory.

    Raises:
        SceneError: the body has no extent, extends too far, or needs too many cells.
    """
    source, box = str(geometry.mesh), np.zeros((2, 3))
    with suppress(Exception):  # a plain exception of gmsh: the box is empty
        box = np.reshape(gmsh.model.getBoundingBox(-1, -1), (2, 3))
    near = gmsh.model.getEntitiesInBoundingBox(*(-FARTHEST,) * 3, *(FARTHEST,) * 3, 0)
    # a point whose coordinates are not numbers is not near
    if len(near) < len(gmsh.model.getEntities(0)) or np.abs(box).max() > FARTHEST:
        reason = f"the geometry extends too far: coordinates must be at most {FARTHEST:g}"
        raise refuse(source, reason, ErrorKind.MESH)
    extent = float(np.ptp(box, axis=0).max())
    if extent == 0.0:
        raise refuse(source, "the geometry has no body with an extent", ErrorKind.MESH)
    if geometry.size is not None and geometry.size * MOST_CELLS < extent:
        allowed = f"must be at least {extent / MOST_CELLS:.3g} for a body of {extent:.3g} m"
        raise Where(source, "geometry.size").refuse(geometry.size, allowed)


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
            listed = ", ".join(sorted(known - {"structured"}))
            allowed = f"name must be one of {listed}" if listed else "there is no DefineConstant"
            where = Where(str(geometry.mesh), f"geometry.parameters.{name}")
            raise where.refuse(value, allowed, ErrorKind.UNKNOWN_KEY)
        gmsh.parser.setNumber(name, [value])


def add_mesh(gmsh: Any, source: str, file: MeshFile) -> Loaded:
    """Put a mesh file into a new model of gmsh."""
    dimensions = [block.shape.dimension for block in file.blocks]
    highest = max(dimensions)
    gmsh.model.add("file")
    gmsh.model.addDiscreteEntity(highest, 1)
    gmsh.model.mesh.addNodes(highest, 1, np.arange(len(file.points)) + 1, file.points.ravel())
    entities: dict[tuple[int, str], list[int]] = {}
    for block, d in zip(file.blocks, dimensions, strict=True):
        member = np.array(list(block.groups.values()), dtype=bool)
        kinds, which = np.unique(
            member.reshape(len(block.groups), len(block.nodes)).T, axis=0, return_inverse=True
        )
        for k, marks in enumerate(kinds):
            entity = gmsh.model.addDiscreteEntity(d)
            gmsh.model.mesh.addElementsByType(
                entity, block.kind, [], (block.nodes[which.ravel() == k] + 1).ravel()
            )
            for name in (name for name, marked in zip(block.groups, marks, strict=True) if marked):
                entities.setdefault((d, name), []).append(entity)
    # one call per name, because gmsh leaves a second group of this name unnamed
    for (d, name), members in entities.items():
        gmsh.model.addPhysicalGroup(d, members, name=name)
    warnings: list[str] = [note_of(note).saying(f"{source}: {note}") for note in file.notes]
    if file.not_read:
        warnings.append(f"{source}: not read: {', '.join(file.not_read)}")
    sets = {name: nodes + 1 for name, nodes in file.node_groups.items()}
    return Loaded(sets, tuple(warnings), file.physics)


def mesh_of_model(gmsh: Any, sets: dict[str, Ints] | None = None) -> MeshFile:
    """The mesh, the physical groups and the node sets of the current model of gmsh."""
    numbers, points = model_nodes(gmsh)
    blocks = []
    for d, entity in gmsh.model.getEntities():
        tags = gmsh.model.getPhysicalGroupsForEntity(d, entity)
        names = [gmsh.model.getPhysicalName(d, tag) or str(tag) for tag in tags]
        for kind, elements, nodes in zip(*gmsh.model.mesh.getElements(d, entity), strict=True):
            rows = np.searchsorted(numbers, nodes.reshape(len(elements), -1))
            groups = {name: np.ones(len(rows), dtype=bool) for name in names}
            blocks.append(Block(int(kind), rows, groups))
    groups = {name: np.searchsorted(numbers, nodes) for name, nodes in (sets or {}).items()}
    return MeshFile(points, tuple(blocks), groups)


def _has_serendipity_cells(gmsh: Any) -> bool:
    """Whether cells of the current model lack the nodes in the middle of faces."""
    return bool({16, 17} & set(map(int, gmsh.model.mesh.getElementTypes())))


def _has_several_shapes(gmsh: Any) -> bool:
    """Whether the cells of the current model have several shapes, or are wedges or pyramids."""
    d = gmsh.model.getDimension()
    kinds = map(int, gmsh.model.mesh.getElementTypes(d))
    shapes = {SHAPES[kind].corners for kind in kinds if kind in SHAPES}
    return len(shapes) > 1 or bool(shapes & {5, 6})


def _check_content(gmsh: Any, source: str) -> None:
    """Check that gmsh found cells and that node numbers differ; gmsh would keep the first node.

    Raises:
        SceneError: there are no cells, or a number was given twice.
    """
    if gmsh.model.getDimension() < 0:
        raise refuse(source, "holds no cells", ErrorKind.MESH)
    for line in gmsh.logger.get():
        if match := re.search(r"duplicate node (\d+)", line):
            raise refuse(source, f"node {match[1]} is given twice")


@contextmanager
def _errors(gmsh: Any, source: str, link: str = "") -> Iterator[None]:
    """Raise the first error in the log of gmsh, which does not raise all of its errors.

    Args:
        gmsh: the open gmsh.
        source: the file, for messages.
        link: another name of the file, which gmsh knows.

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
        sentence = sentence.replace(link or source, source)
        # by Error() in a .geo file
        match = re.match(r"(geometry\.parameters\.\w+) = ", sentence)
        kind, key = (ErrorKind.RANGE, match[1]) if match else (ErrorKind.MESH, "")
        raise SceneError(f"{source}: {sentence}", kind=kind, key=key, source=source) from failure


def _parameters(path: Path) -> set[str]:
    """Names of the parameters in the DefineConstant blocks of a .geo file."""
    text = re.sub(
        r'"[^"\n]*"|//[^\n]*|/\*.*?\*/', "", path.read_text(errors="replace"), flags=re.DOTALL
    )
    while (inner := re.sub(r"\{[^{}]*\}", "", text)) != text:
        text = inner
    blocks = re.findall(r"\bDefineConstant\s*\[([^]]*)\]", text)
    names = {entry.partition("=")[0].strip() for block in blocks for entry in block.split(",")}
    return names - {""}
