"""Meshes of CAD bodies in gmsh: sizes of the cells, finer attempts, and curved cells.

The cells follow the curvature κ of the curves and faces, and grow from the refined faces f:

    h(x) = min(size, 2π / (curvature · κ), size_f + (growth − 1) · distance(x, f)).    (1)
"""

import re
from typing import Any

import numpy as np

from fenicsrom.errors import ErrorKind, refuse
from fenicsrom.fem.mesh.gmsh_queries import Floats, model_nodes, straight_places
from fenicsrom.formats.shapes import STRAIGHT
from fenicsrom.scene import Geometry
from fenicsrom.scene.base.rules import Where
from fenicsrom.words import are, counted

SMALLEST = 0.05
"""Default of the smallest cells, relative to the cell size."""

ATTEMPTS = 4
"""Attempts to mesh a body; each one halves the cells along curved faces."""

SAMPLES = 100
"""Points along a curve from which the distance to a refined face is measured."""

CORNER = 2.35
"""Smaller angles between two curves, in rad, are corners of a structured face."""

LEAST_JACOBIAN = 0.01
"""Curved cells with a smaller scaled Jacobian are made straighter."""

MANY = 0.01
"""If more curved cells than this share are inverted, gmsh moves nodes inside the body first."""

HALVINGS = 4
"""After so many halvings of its bulge, an edge becomes straight."""


def mesh_cad(gmsh: Any, geometry: Geometry) -> tuple[str, ...]:
    """Mesh the body of the current model, whose faces become groups.

    Several bodies become groups, too; where they touch, they share faces and nodes.

    Returns:
        Sentences for the user.

    Raises:
        SceneError: the body cannot be meshed.
    """
    d, source = geometry.dimension, str(geometry.mesh)
    if any(gmsh.model.occ.getMass(d, tag) <= 0.0 for tag in _tags(gmsh, d)):  # gmsh would crash
        raise refuse(source, "a body has no volume", ErrorKind.MESH)
    faces = _named_faces(gmsh, d)
    for name, members in faces.items():
        gmsh.model.addPhysicalGroup(d - 1, members, name=name)
    structured = geometry.cells == "structured"
    if not structured:
        _refine(gmsh, geometry, faces)
    notes = _generate(gmsh, geometry, faces)
    if structured:
        _check_structured(gmsh, geometry)
    if geometry.curved:
        if number := make_curved(gmsh, d):
            notes.append(f"{geometry.mesh}: {straightened(number)}")
    return tuple(notes)


def make_curved(gmsh: Any, d: int) -> int:
    """Make the straight cells of the current model curved; give the number of straightened cells.

    If many cells are inside out, as in thin walls, gmsh's elastic analogy moves the nodes inside
    the body. It takes seconds, and leaves a few cells at sharp edges, which become straighter.
    """
    gmsh.model.mesh.setOrder(2)
    tags = np.concatenate(gmsh.model.mesh.getElements(d)[1])
    quality = gmsh.model.mesh.getElementQualities(tags, "minSJ")
    if np.count_nonzero(quality < LEAST_JACOBIAN) > MANY * len(tags):
        gmsh.model.mesh.optimize("HighOrderElastic")
    number = straighten_inverted(gmsh, d)
    gmsh.logger.stop()  # it holds warnings on the cells that were inside out
    gmsh.logger.start()
    return number


def straightened(number: int) -> str:
    """Say that curved cells were made straighter."""
    return (
        f"{counted(number, 'curved cell')} would be inside out and {are(number)} made straighter; "
        "smaller cells would keep the curves there"
    )


def _named_faces(gmsh: Any, d: int) -> dict[str, list[int]]:
    """The faces by their name in the file or else by their number; bodies that touch are joined.

    Each of several bodies becomes a group.
    """
    bodies = [tag for _, tag in gmsh.model.getEntities(d)]
    names = {tag: _name(gmsh, d, tag) for tag in bodies}
    given = []
    if len(bodies) > 1:
        given = [(_mark(gmsh, d - 1, tag), _name(gmsh, d - 1, tag)) for tag in _tags(gmsh, d - 1)]
        gmsh.model.occ.fragment([(d, tag) for tag in bodies], [])
        gmsh.model.occ.synchronize()
        for tag, name in names.items():
            shown = f"body {tag}" if name == str(tag) else name
            gmsh.model.addPhysicalGroup(d, [tag], name=shown)
    faces: dict[str, list[int]] = {}
    for face in _tags(gmsh, d - 1):
        name = str(face) if given else _name(gmsh, d - 1, face)
        if given:
            mark = _mark(gmsh, d - 1, face)
            near = (old for other, old in given if np.allclose(mark, other, rtol=1e-6, atol=1e-9))
            name = next(near, name)
        faces.setdefault(name, []).append(face)
    return dict(sorted(faces.items(), key=lambda item: (item[0].zfill(9), item[0])))


def _tags(gmsh: Any, d: int) -> list[int]:
    return [tag for _, tag in gmsh.model.getEntities(d)]


def _mark(gmsh: Any, d: int, tag: int) -> Floats:
    """Numbers by which a face is recognised: its centre in m, and the root of its area."""
    size = gmsh.model.occ.getMass(d, tag) ** (1.0 / d)
    return np.array([*gmsh.model.occ.getCenterOfMass(d, tag), size])


def _name(gmsh: Any, d: int, tag: int) -> str:
    """The name of a face or body in the file, or else its number."""
    name = str(gmsh.model.getEntityName(d, tag)).rpartition("/")[2]
    return str(tag) if name.startswith("Open CASCADE") else name or str(tag)


def _refine(gmsh: Any, geometry: Geometry, faces: dict[str, list[int]]) -> None:
    """Let the cells grow from the refined faces, by (1).

    Raises:
        SceneError: there is no face of this name.
    """
    source, meshing, fields = str(geometry.mesh), geometry.meshing, []
    for index, near in enumerate(meshing.near or ()):
        if near.group not in faces:
            key = near.origin or f"geometry.meshing.near[{index}].group"
            named = ", ".join(sorted(faces))
            reason = f"there is no facet group {near.group!r}; the facet groups are {named}"
            raise refuse(source, reason, ErrorKind.PLACE, key)
        size = near.size or 0.5 * geometry.size
        distance = gmsh.model.mesh.field.add("Distance")
        kind = "SurfacesList" if geometry.dimension == 3 else "CurvesList"
        gmsh.model.mesh.field.setNumbers(distance, kind, faces[near.group])
        gmsh.model.mesh.field.setNumber(distance, "Sampling", SAMPLES)
        growing = gmsh.model.mesh.field.add("MathEval")
        growth = f"{size!r} + {meshing.growth - 1.0!r} * F{distance}"
        gmsh.model.mesh.field.setString(growing, "F", growth)
        fields.append(growing)
    if fields:
        least = gmsh.model.mesh.field.add("Min")
        gmsh.model.mesh.field.setNumbers(least, "FieldsList", fields)
        gmsh.model.mesh.field.setAsBackgroundMesh(least)


def _generate(gmsh: Any, geometry: Geometry, faces: dict[str, list[int]]) -> list[str]:
    """Mesh the body, with smaller cells on curved faces if the mesh of the surface crosses itself.

    Returns:
        Sentences for the user.

    Raises:
        SceneError: the body cannot be meshed with the smallest of these cells.
    """
    source, d, meshing = str(geometry.mesh), geometry.dimension, geometry.meshing
    size, failure = geometry.size, ""
    gmsh.option.setNumber("Mesh.MeshSizeMax", size)
    for attempt in range(ATTEMPTS):
        finer = 2.0**attempt
        gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", meshing.curvature * finer)
        smallest = (meshing.smallest or SMALLEST * size) / finer
        given = [near.size for near in meshing.near or () if near.size is not None]
        gmsh.option.setNumber("Mesh.MeshSizeMin", min(smallest, size, *given))
        if not meshing.curvature:
            gmsh.option.setNumber("Mesh.MeshSizeMax", size / finer)
        if geometry.cells == "structured":
            gmsh.model.mesh.setTransfiniteAutomatic([], CORNER, True)
        problem = _attempt(gmsh, d, faces)
        if not problem:
            if not attempt:
                return []
            used = f"curvature = {meshing.curvature * finer:g}"
            used = used if meshing.curvature else f"size = {size / finer:.3g}"
            return [f"{source}: {failure}; the body was meshed with {used} instead"]
        failure = failure or problem
    least = f"size = {size / finer:.3g} m and curvature = {meshing.curvature * finer:g}"
    reason = f"{failure}; it could not be meshed with {least} either; repair the face in the CAD "
    reason += "program, or give geometry.size and [geometry.meshing] smaller cells"
    raise refuse(source, reason, ErrorKind.MESH, "geometry.size")


def _attempt(gmsh: Any, d: int, faces: dict[str, list[int]]) -> str:
    """Mesh the body; give "", or say which face failed and where."""
    gmsh.model.mesh.clear()
    gmsh.logger.stop()
    gmsh.logger.start()
    failure = ""
    try:
        gmsh.model.mesh.generate(d)
    except Exception as error:  # gmsh raises plain exceptions
        failure = str(error)
    lines = gmsh.logger.get()
    errors = [line.partition(":")[2].strip() for line in lines if line.startswith("Error")]
    if not errors and not failure:
        return ""
    names = {face: name for name, members in faces.items() for face in members}
    entities = gmsh.model.mesh.getLastEntityError()
    failed = [names.get(tag, str(tag)) for dim, tag in entities if dim == d - 1]
    text = " ".join(errors)
    failed += [names.get(int(tag), tag) for tag in re.findall(r"\bsurface (\d+)", text)]
    place = re.search(r"\(([-+.\de]+),([-+.\de]+),([-+.\de]+)\)", text)
    what = "the surface mesh crosses itself" if "PLC" in text else (errors or [failure])[0]
    if failed:
        listed = ", ".join(dict.fromkeys(failed))
        what = f"the mesh of {'face' if len(set(failed)) == 1 else 'the faces'} {listed} failed"
        what += " (it crosses another one)" if "PLC" in text else ""
    return what + (f" at ({', '.join(place.groups())})" if place else "")


def _check_structured(gmsh: Any, geometry: Geometry) -> None:
    """Check that all cells are quadrilaterals or hexahedra.

    Raises:
        SceneError: they are not.
    """
    d, source = geometry.dimension, str(geometry.mesh)
    box = STRAIGHT[d, 2**d]
    other = [t for t in _tags(gmsh, d) if set(gmsh.model.mesh.getElementTypes(d, t)) - {box}]
    if other:
        names = ", ".join(str(tag) for tag in other)
        reason = f"body {names} has no mesh of hexahedra, because it does not have six faces of "
        reason += "four sides each; leave the key out"
        raise Where(source, "geometry.cells").refuse("structured", reason, ErrorKind.CONFLICT)


def straighten_inverted(gmsh: Any, d: int) -> int:
    """Make curved cells straighter until none of them is inside out.

    The nodes between the corners of such a cell move half of the way to their places in the
    straight cell, a few times, and then the rest of the way.

    Args:
        gmsh: the open gmsh, whose current model has cells of degree 2 that are valid if straight.
        d: dimension of the cells.

    Returns:
        The number of cells that were changed.
    """
    numbers, points = model_nodes(gmsh)
    kinds = gmsh.model.mesh.getElementTypes(d)
    cells = [gmsh.model.mesh.getElementsByType(kind) for kind in kinds]
    halvings = np.zeros(len(numbers), dtype=int)
    changed: set[int] = set()
    moved = True
    while moved:
        moved = False
        for kind, (tags, nodes) in zip(kinds, cells, strict=True):
            quality = np.asarray(gmsh.model.mesh.getElementQualities(tags, "minSJ"))
            rows = np.searchsorted(numbers, nodes.reshape(len(tags), -1))
            bad = np.flatnonzero(quality < LEAST_JACOBIAN)
            rest = straight_places(gmsh, int(kind), points[rows[bad]])
            for row, places in zip(rows[bad], rest, strict=True):
                free = np.flatnonzero(halvings[row] <= HALVINGS)
                free = free[np.abs(points[row[free]] - places[free]).max(axis=1, initial=0.0) > 0.0]
                part = np.where(halvings[row[free]] < HALVINGS, 0.5, 1.0)[:, None]
                points[row[free]] += part * (places[free] - points[row[free]])
                halvings[row[free]] += 1
                for node in row[free]:
                    gmsh.model.mesh.setNode(numbers[node], points[node], [])
                moved = moved or len(free) > 0
            changed |= set(tags[bad].tolist())
    return len(changed)
