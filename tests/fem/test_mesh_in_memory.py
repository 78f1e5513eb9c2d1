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

from fenicsrom.errors import ErrorKind, SceneError
from fenicsrom.fem.mesh import mesh_from_dolfinx, mesh_from_gmsh_model
from fenicsrom.fem.mesh_data import Mesh
from fenicsrom.fem.supports import unclamped_pieces


def length_of(mesh: Mesh, group: str) -> float:
    one = fem.Constant(mesh.domain, 1.0)
    return float(fem.assemble_scalar(fem.form(one * mesh.surface(group))))


@pytest.fixture
def rectangle() -> Iterator[Any]:
    """An open gmsh with a meshed rectangle of 2 by 1, in centimetres."""
    gmsh.initialize(readConfigFiles=False, interruptible=False)
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.model.add("mine")
    surface = gmsh.model.occ.addRectangle(0.0, 0.0, 0.0, 200.0, 100.0)
    gmsh.model.occ.synchronize()
    sides = {}
    for _, tag in gmsh.model.getEntities(1):
        x = gmsh.model.occ.getCenterOfMass(1, tag)[0]
        sides[x] = tag
    gmsh.model.addPhysicalGroup(2, [surface], name="solid")
    gmsh.model.addPhysicalGroup(1, [sides[0.0]], name="root")
    gmsh.model.addPhysicalGroup(1, [sides[200.0]], name="tip")
    gmsh.option.setNumber("Mesh.MeshSizeMax", 50.0)
    gmsh.model.mesh.generate(2)
    yield gmsh
    gmsh.finalize()


def test_mesh_of_gmsh_model_has_its_groups_and_unit(rectangle: Any) -> None:
    mesh = mesh_from_gmsh_model(2, comm=MPI.COMM_SELF, scale=0.01)
    assert mesh.extent() == pytest.approx(2.0, rel=1e-12)
    assert length_of(mesh, "root") == pytest.approx(1.0, rel=1e-12)
    assert length_of(mesh, "tip") == pytest.approx(1.0, rel=1e-12)
    assert unclamped_pieces(mesh, ["root"]) == 0


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


def test_tag_that_dolfinx_mesh_lacks_is_refused() -> None:
    domain, tags = tagged_square()
    with pytest.raises(SceneError) as caught:
        mesh_from_dolfinx(domain, tags, {"root": 8})
    assert caught.value.kind is ErrorKind.PLACE
