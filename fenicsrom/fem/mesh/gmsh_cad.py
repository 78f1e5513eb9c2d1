"""Meshes of CAD bodies in gmsh: sizes of the cells, finer attempts, and curved cells.

The cells follow the curvature κ of the curves and faces, and grow from the refined faces f:

    h(x) = min(size, 2π / (curvature · κ), size_f + (growth − 1) · distance(x, f)).    (1)

Queries and edits of the model in an open gmsh, as numpy arrays.

Node numbers are those of gmsh. A "kind" is gmsh's number of an element type.
"""

import re
from collections.abc import Iterable
from dataclasses import MISSING
from itertools import chain, combinations
from typing import Any

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from fenicsrom.errors import ErrorKind, refuse
from fenicsrom.formats.mesh_file import Floats, Ints
from fenicsrom.formats.shapes import SHAPES, STRAIGHT, distinct
from fenicsrom.notes import Note, NoteKind
from fenicsrom.scene import Geometry
from fenicsrom.scene.base.rules import Where
from fenicsrom.words import are, counted

QUADRATIC = {1: 8, 2: 9, 3: 10, 4: 11, 5: 12}
"""Kind of degree 2, with all nodes, of each straight kind."""


def group_entities(gmsh: Any, source: str, d: int) -> dict[str, list[int]]:
    """Entities of each physical group of dimension d, by its name or, without a name, its number.

    Raises:
        SceneError: a group has no elements.
    """
    groups = {}
    for _, tag in gmsh.model.getPhysicalGroups(d):
        name = gmsh.model.getPhysicalName(d, tag) or str(tag)
        groups[name] = [*groups.get(name, []), *gmsh.model.getEntitiesForPhysicalGroup(d, tag)]
    for name, entities in groups.items():
        blocks = [block for on in entities for block in gmsh.model.mesh.getElements(d, on)[1]]
        if not any(len(block) for block in blocks):
            reason = f"group {name!r} is empty; it must have cells or facets of the mesh"
            raise refuse(source, reason, ErrorKind.MESH)
    return groups


def model_nodes(gmsh: Any) -> tuple[Ints, Floats]:
    """Sorted numbers (n,) of the nodes, and their coordinates (n, 3)."""
    numbers, coordinates, _ = gmsh.model.mesh.getNodes()
    order = np.argsort(numbers)
    return numbers[order], coordinates.reshape(-1, 3)[order]


def fits(gmsh: Any, given: int, kind: int) -> bool:
    """Whether elements `given` can be used as `kind`.

    Elements can be used if they are of this kind, or if this kind is straight and has the same
    vertices.
    """
    wanted, found = (gmsh.model.mesh.getElementProperties(k) for k in (kind, given))
    return given == kind or (wanted[2] == 1 and found[5] == wanted[5])


def elements_of(gmsh: Any, d: int, entities: list[int], kind: int) -> Ints:
    """Node numbers (m, nodes of the kind) of the elements that can be used as a kind."""
    width = gmsh.model.mesh.getElementProperties(kind)[3]
    blocks = [np.empty((0, width), dtype=np.uint64)]
    for entity in entities:
        for given, elements, nodes in zip(*gmsh.model.mesh.getElements(d, entity), strict=True):
            if fits(gmsh, given, kind):
                blocks.append(nodes.reshape(len(elements), -1)[:, :width])
    return np.concatenate(blocks)


def cell_sides(gmsh: Any, entity: int, kind: int, d: int) -> Ints:
    """Node numbers (k, nodes) of the edges (d = 1) or faces (d = 2) of the cells of an entity.

    Vertices come first.
    """
    number = len(gmsh.model.mesh.getElementsByType(kind, entity)[0])
    shape = SHAPES[straight_kind(gmsh, kind)]
    if d == 1:
        sides, nodes = shape.edges, gmsh.model.mesh.getElementEdgeNodes(kind, entity, False)
    else:
        sides, vertices = shape.facets, len(shape.facets[0])
        nodes = gmsh.model.mesh.getElementFaceNodes(kind, vertices, entity, False)
    rows = number * len(sides)
    return np.reshape(nodes, (rows, -1)) if number else np.empty((0, 0), dtype=np.uint64)


def boundary_facets(gmsh: Any, d: int, solid: list[int], kind: int) -> tuple[Ints, Ints]:
    """Find the facets that belong to one cell only.

    Returns:
        Node numbers (k, nodes) of the facets, and (k, m) of the corners of all facets of their
        cells.
    """
    sides = [rows for entity in solid if len(rows := cell_sides(gmsh, entity, kind, d - 1))]
    rows, facets = np.concatenate(sides), SHAPES[straight_kind(gmsh, kind)].facets
    corners = rows[:, : len(facets[0])]
    first, _, count = distinct(corners)
    alone = first[count == 1]
    around = corners.reshape(-1, corners.shape[1] * len(facets))[alone // len(facets)]
    return rows[alone], around


def straight_kind(gmsh: Any, kind: int) -> int:
    """The straight kind of the same shape, or 0."""
    _, d, _, _, _, vertices = gmsh.model.mesh.getElementProperties(kind)
    return STRAIGHT.get((d, vertices), 0)


def straight_places(gmsh: Any, kind: int, cells: Floats) -> Floats:
    """The places (c, nodes, d) of the nodes of cells of a kind, if the cells were straight."""
    _, d, _, _, reference, vertices = gmsh.model.mesh.getElementProperties(kind)
    local = np.pad(np.reshape(reference, (-1, d)), ((0, 0), (0, 3 - d)))
    straight = STRAIGHT[d, vertices]
    _, weights, _ = gmsh.model.mesh.getBasisFunctions(straight, local.ravel(), "Lagrange")
    return np.einsum("pn,cnj->cpj", np.reshape(weights, (-1, vertices)), cells[:, :vertices])


def add_elements(gmsh: Any, d: int, kind: int, elements: Ints, tags: Ints) -> None:
    """Add elements of a kind to the model, in one physical group for each tag."""
    for tag in np.unique(tags):
        entity = gmsh.model.addDiscreteEntity(d)
        gmsh.model.mesh.addElementsByType(entity, kind, [], elements[tags == tag].ravel())
        gmsh.model.addPhysicalGroup(d, [entity], int(tag))


UNGLUED = "; [[contacts]] or [[ties]] between these faces, or geometry.glue, keep them apart"
"""What a user can do about bodies that are glued."""

TOUCHING = 1e-6
"""Bodies of a CAD file at smaller distances, relative to their extent, touch."""

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


def mesh_cad(gmsh: Any, geometry: Geometry) -> tuple[set[str], tuple[str, ...]]:
    """Mesh the body of the current model, whose faces become groups.

    Several bodies become groups, too; where they touch, they share faces and nodes.

    Returns:
        The names of faces along which bodies are glued, and sentences for the user.

    Raises:
        SceneError: the body cannot be meshed.
    """
    d, source = geometry.dimension, str(geometry.mesh)
    if any(gmsh.model.occ.getMass(d, tag) <= 0.0 for tag in _tags(gmsh, d)):  # gmsh would crash
        raise refuse(source, "a body has no volume", ErrorKind.MESH)
    faces, glued, notes = _named_faces(gmsh, geometry)
    for name, members in faces.items():
        gmsh.model.addPhysicalGroup(d - 1, members, name=name)
    structured = geometry.cells == "structured"
    if not structured:
        _refine(gmsh, geometry, faces)
    notes += _generate(gmsh, geometry, faces)
    if structured:
        _check_structured(gmsh, geometry)
    if geometry.curved:
        if number := make_curved(gmsh, d):
            notes.append(f"{geometry.mesh}: {straightened(number)}")
    return glued, tuple(notes)


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


def _named_faces(gmsh: Any, geometry: Geometry) -> tuple[dict[str, list[int]], set[str], list[str]]:
    """The faces by their name in the file, or else by their number; `glue` joins bodies that touch.

    Each of several bodies becomes a group. A face keeps its name on its parts on the surface. Its
    parts inside, along which bodies are glued, are groups named by both faces, such as "6+11". If
    no part of a face is on the surface, its name stands for the parts inside.

    Returns:
        The faces of the model by their names; the names of faces with parts inside; and sentences
        for the user.
    """
    d, source = geometry.dimension, str(geometry.mesh)
    solids = gmsh.model.getEntities(d)
    sides = dict.fromkeys(gmsh.model.getBoundary(solids, combined=False, oriented=False))
    names = {side: _name(gmsh, *side) for side in sides}
    if len(solids) == 1:
        return _sorted(_listed((name, tag) for (_, tag), name in names.items())), set(), []
    bodies = {solid: _name(gmsh, *solid) for solid in solids}
    bodies = {s: f"body {name}" if name == str(s[1]) else name for s, name in bodies.items()}
    pieces, notes = _pieces(gmsh, geometry, bodies, names)
    parts = {one: [one] for one in [*solids, *sides]}
    for piece in pieces:
        own = gmsh.model.getBoundary(piece, combined=False, oriented=False)
        old = [*piece, *dict.fromkeys(own)]
        # the map of fragment numbers the unchanged faces wrongly if it removes the old bodies
        if len(piece) > 1:
            found = gmsh.model.occ.fragment(
                piece, old[len(piece) :], removeObject=False, removeTool=False
            )
            parts |= dict(zip(old, found[1], strict=True))
    kept = {part for found in parts.values() for part in found}
    gmsh.model.occ.remove([one for one in parts if one not in kept], recursive=True)
    gmsh.model.occ.synchronize()
    named = bodies | names
    names_of = _listed((part, named[one]) for one, found in parts.items() for part in found)
    body_of = {tag: names for (dim, tag), names in names_of.items() if dim == d}
    face_of = {tag: names for (dim, tag), names in names_of.items() if dim == d - 1}
    for name, tags in _listed((name, tag) for tag, on in body_of.items() for name in on).items():
        gmsh.model.addPhysicalGroup(d, tags, name=name)

    beside = {f: [set(body_of[s]) for s in gmsh.model.getAdjacencies(d - 1, f)[0]] for f in face_of}
    faces = _listed((name, f) for f, on in face_of.items() if len(beside[f]) == 1 for name in on)
    inside = [(name, f) for f, on in face_of.items() if len(beside[f]) > 1 for name in on]
    joints = _listed(
        (tuple(face_of[f]), f)
        for f, near in beside.items()
        if len(near) > 1 and not (near[0] <= near[1] or near[1] <= near[0])
    )
    for on, tags in joints.items():
        both = " and ".join(sorted(set.union(*beside[tags[0]])))
        size = sum(gmsh.model.occ.getMass(d - 1, tag) for tag in tags)
        where = f"face {' on face '.join(on)}, {size:.4g} {'m²' if d == 3 else 'm'}"
        said = f"{source}: {both} touch and are glued there: {where}{UNGLUED}"
        notes.append(Note(NoteKind.REMARK, said, "geometry.mesh"))
    for on in dict.fromkeys(tuple(on) for on in body_of.values() if len(on) > 1):
        notes.append(f"{source}: {' and '.join(on)} overlap; the part in both counts once")
    hidden = _listed((name, f) for name, f in inside if name not in faces)
    glued = {"+".join(on): tags for on, tags in joints.items()}
    return _sorted(faces | hidden | glued), {*glued, *sum(joints, ())}, notes


def _pieces(
    gmsh: Any,
    geometry: Geometry,
    bodies: dict[tuple[int, int], str],
    names: dict[tuple[int, int], str],
) -> tuple[list[list[tuple[int, int]]], list[str]]:
    """The bodies that become one piece each, and sentences on others that touch.

    Args:
        gmsh: the open gmsh.
        geometry: what `glue` and `apart` say of the bodies.
        bodies: the name of each body.
        names: the name of each face.

    Raises:
        SceneError: there is no such body; or bodies in contact would be glued.
    """
    source, glue, number = str(geometry.mesh), geometry.glue, range(len(bodies))
    solids, where = list(bodies), Where(source, "geometry.glue")
    for name in chain(*glue) if isinstance(glue, tuple) else ():
        if name not in bodies.values():
            listed = ", ".join(dict.fromkeys(bodies.values()))
            raise where.refuse(name, f"must name bodies: {listed}", ErrorKind.PLACE)
    owners = _listed(
        (names[side], k)
        for k, solid in enumerate(solids)
        for side in gmsh.model.getBoundary([solid], oriented=False)
    )
    met = {
        (min(i, j), max(i, j))
        for one, other in geometry.apart
        for i in owners.get(one, ())
        for j in owners.get(other, ())
    }
    if not met and glue in (None, True):
        return [solids], []

    def glued(i: int, j: int) -> bool:
        if isinstance(glue, tuple):
            return any({bodies[solids[i]], bodies[solids[j]]} <= set(one) for one in glue)
        return (i, j) not in met if glue is None else glue

    touching = [(i, j) for i, j in combinations(number, 2) if _touch(gmsh, solids[i], solids[j])]
    joined = [pair for pair in touching if glued(*pair)]
    graph = coo_array((np.ones(len(joined)), np.reshape(joined, (-1, 2)).T), (len(solids),) * 2)
    piece, notes = connected_components(graph, directed=False)[1], []
    for i, j in touching:
        one, other = (bodies[solids[k]] for k in (i, j))
        if piece[i] == piece[j] and (i, j) in met:
            reason = f"{one} and {other} have a contact or a tie between their faces, so they must "
            reason += "not be glued, also not through other bodies; list the bodies that are"
            raise where.refuse(MISSING if glue is None else glue, reason, ErrorKind.CONFLICT)
        if piece[i] != piece[j] and (i, j) not in met:
            what = "touch and are not glued, and no contact or tie names their faces"
            notes.append(f"{source}: {one} and {other} {what}: they may pass through each other")
    return [[solids[k] for k in number if piece[k] == p] for p in range(1 + piece.max())], notes


def _touch(gmsh: Any, one: tuple[int, int], other: tuple[int, int]) -> bool:
    """Whether two bodies touch or overlap."""
    a, b = (np.reshape(gmsh.model.getBoundingBox(*body), (2, 3)) for body in (one, other))
    near = TOUCHING * max(np.ptp(a, axis=0).max(), np.ptp(b, axis=0).max())
    if (a[0] > b[1] + near).any() or (b[0] > a[1] + near).any():
        return False
    return bool(gmsh.model.occ.getDistance(*one, *other)[0] <= near)


def _listed(pairs: Iterable[tuple[Any, Any]]) -> dict[Any, list[Any]]:
    """The second entries of pairs by the first one, each once."""
    found: dict[Any, dict[Any, None]] = {}
    for key, value in pairs:
        found.setdefault(key, {})[value] = None
    return {key: list(values) for key, values in found.items()}


def _sorted(faces: dict[str, list[int]]) -> dict[str, list[int]]:
    """Groups in the order of their numbers, then of their names."""
    return dict(sorted(faces.items(), key=lambda item: (item[0].zfill(9), item[0])))


def _tags(gmsh: Any, d: int) -> list[int]:
    return [tag for _, tag in gmsh.model.getEntities(d)]


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
