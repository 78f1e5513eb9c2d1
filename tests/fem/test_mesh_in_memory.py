"""Meshes that are not read from a file: a gmsh model in memory and a dolfinx mesh with tags."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import dolfinx.mesh
import gmsh
import numpy as np
import pytest
from dolfinx import fem
from mpi4py import MPI
from support import beam_scene, gmsh_session, refusal

from fenicsrom.errors import ErrorKind, SceneError
from fenicsrom.fem.body.supports import connected_pieces
from fenicsrom.fem.mesh.mesh import Mesh, mesh_from_dolfinx, mesh_from_gmsh_model
from fenicsrom.fem.solid.solid import solid_of


def length_of(mesh: Mesh, group: str) -> float:
    one = fem.Constant(mesh.domain, 1.0)
    return float(fem.assemble_scalar(fem.form(one * mesh.surface(group))))


@pytest.fixture
def rectangle() -> Iterator[Any]:
    """An open gmsh with a meshed rectangle of 2 by 1, in centimetres."""
    with gmsh_session() as gmsh:
        gmsh.model.add("mine")
        surface = gmsh.model.occ.addRectangle(0.0, 0.0, 0.0, 200.0, 100.0)
        gmsh.model.occ.synchronize()
        edges = [tag for _, tag in gmsh.model.getEntities(1)]
        sides = {gmsh.model.occ.getCenterOfMass(1, tag)[0]: tag for tag in edges}
        gmsh.model.addPhysicalGroup(2, [surface], name="solid")
        gmsh.model.addPhysicalGroup(1, [sides[0.0]], name="root")
        gmsh.model.addPhysicalGroup(1, [sides[200.0]], name="tip")
        gmsh.option.setNumber("Mesh.MeshSizeMax", 50.0)
        gmsh.model.mesh.generate(2)
        yield gmsh


def test_mesh_of_gmsh_model_has_its_groups_and_unit(rectangle: Any) -> None:
    mesh = mesh_from_gmsh_model(2, comm=MPI.COMM_SELF, scale=0.01)
    assert mesh.extent() == pytest.approx(2.0, rel=1e-12)
    assert length_of(mesh, "root") == pytest.approx(1.0, rel=1e-12)
    assert length_of(mesh, "tip") == pytest.approx(1.0, rel=1e-12)
    assert connected_pieces(mesh)[1] == 1


def test_gmsh_model_is_unchanged_after_mesh_was_taken(rectangle: Any) -> None:
    before = gmsh.model.mesh.getNodes()[1]
    mesh_from_gmsh_model(2, comm=MPI.COMM_SELF)
    assert gmsh.model.getCurrent() == "mine" and gmsh.model.list() == ["", "mine"]
    np.testing.assert_array_equal(gmsh.model.mesh.getNodes()[1], before)


def test_gmsh_model_without_open_gmsh_is_refused() -> None:
    with pytest.raises(SceneError) as caught:
        mesh_from_gmsh_model(2, comm=MPI.COMM_SELF)
    assert caught.value.kind is ErrorKind.MESH


def tagged_square() -> tuple[dolfinx.mesh.Mesh, dolfinx.mesh.MeshTags]:
    domain = dolfinx.mesh.create_rectangle(
        MPI.COMM_SELF, [np.zeros(2), np.array([2.0, 1.0])], [4, 2]
    )
    left = dolfinx.mesh.locate_entities_boundary(domain, 1, lambda x: x[0] < 1e-9)
    right = dolfinx.mesh.locate_entities_boundary(domain, 1, lambda x: x[0] > 2.0 - 1e-9)
    facets = np.concatenate([left, right]).astype(np.int32)
    tags = np.repeat([7, 9], [left.size, right.size]).astype(np.int32)
    order = np.argsort(facets)
    return domain, dolfinx.mesh.meshtags(domain, 1, facets[order], tags[order])


def test_groups_of_dolfinx_mesh_are_the_tagged_facets() -> None:
    domain, tags = tagged_square()
    mesh = mesh_from_dolfinx(domain, tags, {"root": 7, "ends": (7, 9)})
    assert length_of(mesh, "root") == pytest.approx(1.0, rel=1e-12)
    assert length_of(mesh, "ends") == pytest.approx(2.0, rel=1e-12)


def test_tags_of_numpy_name_groups() -> None:
    domain, tags = tagged_square()
    groups = {"root": np.int32(7), "ends": np.array([7, 9])}
    assert mesh_from_dolfinx(domain, tags, groups).facet_groups == {"root": (7,), "ends": (7, 9)}


@pytest.mark.parametrize("tag", [7.0, []])
def test_tag_that_is_no_integer_is_refused(tag: Any) -> None:
    domain, tags = tagged_square()
    with refusal(ErrorKind.TYPE, key="groups.root"):
        mesh_from_dolfinx(domain, tags, {"root": tag})


def test_tags_that_are_not_those_of_the_facets_are_refused() -> None:
    domain, tags = tagged_square()
    one = np.ones(1, dtype=np.int32)
    cells = dolfinx.mesh.meshtags(domain, 2, one, one)
    small = dolfinx.mesh.create_unit_square(MPI.COMM_SELF, 1, 1)
    for wrong in (cells, None):
        with refusal(ErrorKind.MESH, key="facet_tags"):
            mesh_from_dolfinx(domain, wrong, {"root": 1})
    with refusal(ErrorKind.MESH, key="facet_tags"):
        mesh_from_dolfinx(small, tags, {"root": 7})
    with refusal(ErrorKind.MESH, key="cell_tags"):
        mesh_from_dolfinx(domain, tags, {"root": 7}, tags)


def test_mesh_with_moved_node_is_refused() -> None:
    def mesh_with(change: float) -> Mesh:
        kind = dolfinx.mesh.CellType.quadrilateral
        domain = dolfinx.mesh.create_unit_square(MPI.COMM_SELF, 4, 4, kind)
        x = domain.geometry.x
        inner = np.flatnonzero(np.all(np.abs(x[:, :2] - 0.5) < 0.1, axis=1))
        x[inner[0], 0] += change
        nothing = np.empty(0, dtype=np.int32)
        return mesh_from_dolfinx(domain, dolfinx.mesh.meshtags(domain, 1, nothing, nothing), {})

    assert mesh_with(0.1).facet_groups == {}
    for change in (0.4, np.nan):
        with refusal(ErrorKind.MESH):
            mesh_with(change)


def test_scene_of_another_dimension_than_the_mesh_is_refused() -> None:
    domain, tags = tagged_square()
    mesh = mesh_from_dolfinx(domain, tags, {"root": 7, "tip": 9, "load": 9})
    with refusal(ErrorKind.MISMATCH, key="geometry.dimension"):
        solid_of(beam_scene(3), mesh)


@pytest.mark.parametrize(
    ("arguments", "kind", "key"),
    [
        ({"dimension": 4}, ErrorKind.RANGE, "dimension"),
        ({"dimension": 2, "scale": np.nan}, ErrorKind.RANGE, "scale"),
    ],
)
def test_wrong_argument_for_gmsh_model_is_refused(
    rectangle: Any, arguments: dict[str, Any], kind: ErrorKind, key: str
) -> None:
    with refusal(kind, key=key):
        mesh_from_gmsh_model(**arguments, comm=MPI.COMM_SELF)


def test_tag_that_dolfinx_mesh_lacks_is_refused() -> None:
    domain, tags = tagged_square()
    with pytest.raises(SceneError) as caught:
        mesh_from_dolfinx(domain, tags, {"root": 8})
    assert caught.value.kind is ErrorKind.PLACE
