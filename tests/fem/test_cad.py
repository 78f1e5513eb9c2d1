"""CAD bodies: sizes of the cells, bodies that touch, finer attempts, and curved cells."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("dolfinx")
import ufl
from dolfinx import fem
from mpi4py import MPI
from support import gmsh_session, refusal, step_file, touching

from fenicsrom.errors import ErrorKind
from fenicsrom.fem.mesh.gmsh_model import pieces_of
from fenicsrom.fem.mesh.inspection import inspect
from fenicsrom.fem.mesh.mesh import Mesh, build_mesh
from fenicsrom.fem.solid.solid import solid_of
from fenicsrom.post.studies.starter import outer_normal
from fenicsrom.scene import Geometry, Plane, Region, parse_scene
from fenicsrom.scene.keys.places import Meshing, Refinement

pytestmark = pytest.mark.slow


def tube(wall: float) -> Callable[[Any], None]:
    """A tube of 30 mm radius and 100 mm length, with a wall in mm."""

    def build(occ: Any) -> None:
        outside = occ.addCylinder(0, 0, 0, 0, 0, 100, 30)
        occ.cut([(3, outside)], [(3, occ.addCylinder(0, 0, -1, 0, 0, 102, 30 - wall))])

    return build


def boxes(occ: Any) -> None:
    """Two boxes that touch on a part of a face."""
    occ.addBox(0, 0, 0, 100, 20, 10)
    occ.addBox(0, 20, 0, 50, 20, 10)


def lap(occ: Any) -> None:
    """Two plates, one on the end of the other."""
    occ.addBox(0, 0, 0, 80, 20, 4)
    occ.addBox(50, 0, 4, 80, 20, 4)


def strip_on_plate(occ: Any) -> None:
    """A strip across a plate: the upper face of the plate is cut in three."""
    occ.addBox(0, 0, 0, 90, 20, 4)
    occ.addBox(30, 0, 4, 30, 20, 4)


def rings_on_plate(occ: Any) -> None:
    """A ring and a pin at the middle of a plate: four parts of its face have one centroid."""
    occ.addBox(-20, -20, 0, 40, 40, 4)
    ring = occ.addCylinder(0, 0, 4, 0, 0, 6, 14)
    occ.cut([(3, ring)], [(3, occ.addCylinder(0, 0, 4, 0, 0, 6, 9))])
    occ.addCylinder(0, 0, 4, 0, 0, 6, 4)


def bolted_plates(occ: Any) -> None:
    """A bolt with a head through two plates."""
    plates = [(3, occ.addBox(-15, -15, 5 * k, 30, 30, 5)) for k in range(2)]
    shaft, head = occ.addCylinder(0, 0, 0, 0, 0, 10, 4), occ.addCylinder(0, 0, 10, 0, 0, 4, 7)
    bolt = occ.fuse([(3, shaft)], [(3, head)])[0]
    occ.cut(plates, bolt, removeTool=False)


def faces_of_file(path: Path) -> dict[str, tuple[float, Any]]:
    """Area (m²) and box (6,) (m) of each face of a .step file, by its number."""
    with gmsh_session() as gmsh:
        gmsh.option.setString("Geometry.OCCTargetUnit", "M")
        occ = gmsh.model.occ
        occ.importShapes(str(path))
        occ.synchronize()
        faces = [tag for _, tag in gmsh.model.getEntities(2)]
        return {str(f): (occ.getMass(2, f), np.array(occ.getBoundingBox(2, f))) for f in faces}


def read(path: Path, size: float, **keys: Any) -> Mesh:
    """The mesh of a .step file."""
    geometry = Geometry(mesh=path, dimension=3, size=size, **keys)
    return build_mesh(geometry, MPI.COMM_WORLD)


def volume(mesh: Mesh) -> float:
    """The volume of a mesh, m³."""
    form = fem.form(fem.Constant(mesh.domain, 1.0) * ufl.dx(degree=6))
    return float(fem.assemble_scalar(form))


def cells(mesh: Mesh) -> int:
    """The number of cells."""
    return int(mesh.domain.topology.index_map(3).size_global)


def test_thin_wall_that_crosses_itself_is_meshed_finer(tmp_path: Path) -> None:
    """Eight or sixteen cells along the circles of a thin tube cross each other."""
    mesh = read(step_file(tmp_path / "tube.step", tube(0.5)), 0.03, curved=True)
    assert any("curvature = 32" in warning for warning in mesh.warnings)
    assert volume(mesh) == pytest.approx(np.pi * (0.03**2 - 0.0295**2) * 0.1, rel=2e-3)


def test_wall_that_no_cell_fits_is_refused_with_its_face(tmp_path: Path) -> None:
    path = step_file(tmp_path / "foil.step", tube(0.01))
    with refusal(ErrorKind.MESH, "geometry.size", "foil.step", names="face 4"):
        read(path, 0.03)


def test_curved_cells_have_the_volume_of_the_body(tmp_path: Path) -> None:
    path = step_file(tmp_path / "pin.step", lambda occ: occ.addCylinder(0, 0, 0, 0, 0, 50, 5))
    exact = np.pi * 0.005**2 * 0.05
    assert volume(read(path, 0.01)) < 0.95 * exact
    assert volume(read(path, 0.01, curved=True)) == pytest.approx(exact, rel=5e-3)


def test_curvature_sets_the_number_of_cells_along_a_circle(tmp_path: Path) -> None:
    """The end of a pin is a polygon of n edges with the area n/2 r² sin(2π/n)."""
    path = step_file(tmp_path / "pin.step", lambda occ: occ.addCylinder(0, 0, 0, 0, 0, 50, 5))

    def polygon(number: float) -> float:
        return 0.5 * number * 0.005**2 * float(np.sin(2.0 * np.pi / number))

    for number in (6.0, 16.0):
        mesh = read(path, 0.01, meshing=Meshing(curvature=number, smallest=1e-4))
        end = fem.form(fem.Constant(mesh.domain, 1.0) * mesh.surface("3"))
        assert polygon(number - 1e-6) <= fem.assemble_scalar(end) <= polygon(number + 1.1)


def test_bodies_that_touch_are_joined_and_named(tmp_path: Path) -> None:
    found = inspect(step_file(tmp_path / "boxes.step", boxes), size=5e-3)
    sizes = {group.name: group.size for group in found.groups if group.kind == "cells"}
    assert found.refusal is None and found.pieces == 1
    assert sizes["body 1"] == pytest.approx(2e-5) and sizes["body 2"] == pytest.approx(1e-5)


@pytest.mark.parametrize("build", [strip_on_plate, rings_on_plate, bolted_plates])
def test_faces_of_touching_bodies_keep_their_places(
    build: Callable[[Any], None], tmp_path: Path
) -> None:
    """The parts of a face on the surface and inside have its area and lie in its box."""
    path = step_file(tmp_path / "bodies.step", build)
    found = inspect(path, size=0.01)
    assert found.refusal is None and found.pieces == 1
    groups = [group for group in found.groups if group.kind == "facets"]
    joints = [group for group in groups if "+" in group.name]
    said = " ".join(found.warnings)
    assert joints and all(j.name.replace("+", " on face ") in said for j in joints)
    inside = {tuple(sorted(row)) for joint in joints for row in np.asarray(joint.members)}
    for number, (area, box) in faces_of_file(path).items():
        parts = [g for g in joints if number in g.name.split("+")]
        own = [g for g in groups if g.name == number]
        parts += [g for g in own if tuple(sorted(np.asarray(g.members)[0])) not in inside]
        size = sum(float(group.size or 0.0) for group in parts)
        assert size == pytest.approx(area, rel=0.11)  # circles are octagons
        for group in parts:
            assert (group.low > box[:3] - 1e-5).all() and (group.high < box[3:] + 1e-5).all()


def test_face_of_a_glued_body_is_the_face_that_a_plane_picks(tmp_path: Path) -> None:
    mesh = read(step_file(tmp_path / "lap.step", lap), 0.01)
    for name, z in (("12", 0.008), ("5", 0.0)):
        plane = Plane(point=(0.0, 0.0, z), normal=(0.0, 0.0, 1.0))
        assert set(mesh.facets(name)) == set(mesh.facets(Region(plane=plane))) != set()
    middle = Plane(point=(0.0, 0.0, 0.004), normal=(0.0, 0.0, 1.0))
    surface = set(mesh.facets("6")) | set(mesh.facets("11"))
    assert surface == set(mesh.facets(Region(plane=middle)))
    assert mesh.reaches_inside("6+11") and not mesh.reaches_inside("6")


def test_contact_on_a_glued_face_is_refused(tmp_path: Path) -> None:
    path, mesh = step_file(tmp_path / "lap.step", lap), None
    contact = touching(normal=[0.0, 0.0, -1.0], gap=0.0)
    table = {
        "geometry": {"mesh": path.name, "dimension": 3, "size": 0.02, "degree": 1},
        "material": {"young": 2e11, "poisson": 0.3, "density": 7800.0},
        "supports": [{"group": "1"}],
        "time": {"duration": 1e-3, "step": 1e-5},
    }
    for group, at in (("6+11", "nodes"), ("6", "mean")):
        contacts = {"contacts": [{**contact, "group": group, "at": at}]}
        scene = parse_scene(table | contacts, "scene", tmp_path, unloaded=True)
        mesh = mesh or build_mesh(scene.geometry, MPI.COMM_WORLD)
        with refusal(ErrorKind.PLACE, "contacts[0].group", "scene", names=f"'{group}'"):
            solid_of(scene, mesh)


def base_with_foot(occ: Any) -> None:
    """A cover (2) and a foot (3) stand on a base (1); a rib (4) stands on the cover."""
    occ.addBox(0, 0, 0, 120, 20, 5)
    occ.addBox(80, 0, 5, 100, 20, 5)
    occ.addBox(0, 0, 5, 20, 20, 10)
    occ.addBox(150, 0, 10, 30, 20, 6)


@pytest.mark.parametrize(
    ("keys", "glued", "said"),
    [
        ({}, {"6+11", "6+17", "12+23"}, 0),
        ({"glue": False}, set(), 3),
        ({"apart": (("11", "6"),)}, {"6+17", "12+23"}, 0),
        ({"glue": (("body 1", "body 3"),)}, {"6+17"}, 2),
    ],
)
def test_glue_chooses_the_bodies_that_share_nodes(
    keys: dict[str, Any], glued: set[str], said: int, tmp_path: Path
) -> None:
    """By default all that touch, without the faces of contacts and ties."""
    mesh = read(step_file(tmp_path / "base.step", base_with_foot), 0.02, **keys)
    assert {name for name in mesh.facet_groups if "+" in name} == glued
    assert sum("may pass through" in str(one) for one in mesh.warnings) == said
    assert volume(mesh) == pytest.approx(2.96e-5)
    nodes = mesh.domain.geometry.dofmap
    assert len(set(pieces_of(nodes, 1 + nodes.max()))) == 4 - len(glued)


def test_bodies_in_contact_that_a_third_body_joins_are_refused(tmp_path: Path) -> None:
    def bridged(occ: Any) -> None:
        lap(occ)
        occ.addBox(60, 20, 0, 10, 5, 8)

    path = step_file(tmp_path / "three.step", bridged)
    with refusal(ErrorKind.MISSING, "geometry.glue", path.name, names="body 1 and body 2"):
        read(path, 0.02, apart=(("6", "11"),))
    with refusal(ErrorKind.PLACE, "geometry.glue", path.name, names="body 1, body 2, body 3"):
        read(path, 0.02, glue=(("body 1", "cover"),))
    glue = (("body 1", "body 3"),)
    assert read(path, 0.02, apart=(("6", "11"),), glue=glue).has_facets("4+15")


def test_face_of_a_support_has_smaller_cells(tmp_path: Path) -> None:
    """By default half as large, so that four times as many lie on the face."""
    path = step_file(tmp_path / "box.step", lambda occ: occ.addBox(0, 0, 0, 100, 20, 10))
    table = {
        "geometry": {"mesh": path.name, "dimension": 3, "size": 5e-3},
        "material": {"young": 2e11, "poisson": 0.3, "density": 7800.0},
        "supports": [{"group": "1"}],
    }
    geometry = parse_scene(table, "scene", tmp_path, unloaded=True).geometry
    assert geometry.meshing.near == (Refinement(group="1"),)
    mesh, plain = build_mesh(geometry, MPI.COMM_WORLD), read(path, 5e-3)
    assert len(mesh.facets("1")) > 3 * len(plain.facets("1"))
    assert len(mesh.facets("2")) == len(plain.facets("2"))
    for growth, few in ((1.2, False), (4.0, True)):
        near = (Refinement(group="1", size=5e-4),)
        found = cells(read(path, 5e-3, meshing=Meshing(near=near, growth=growth)))
        assert (found < 10_000) == few


def test_unknown_face_is_refused(tmp_path: Path) -> None:
    path = step_file(tmp_path / "box.step", lambda occ: occ.addBox(0, 0, 0, 100, 20, 10))
    with refusal(ErrorKind.PLACE, "geometry.meshing.near[0].group", "box.step", names="'7'"):
        read(path, 5e-3, meshing=Meshing(near=(Refinement(group="7"),)))


def test_unknown_face_is_refused_by_the_key_that_names_it(tmp_path: Path) -> None:
    path = step_file(tmp_path / "box.step", lambda occ: occ.addBox(0, 0, 0, 100, 20, 10))
    table = {
        "geometry": {"mesh": path.name, "dimension": 3, "size": 5e-3},
        "material": {"young": 2e11, "poisson": 0.3, "density": 7800.0},
        "supports": [{"group": "7"}],
    }
    geometry = parse_scene(table, "scene", tmp_path, unloaded=True).geometry
    with refusal(ErrorKind.PLACE, "supports[0].group", "box.step", names="'7'"):
        build_mesh(geometry, MPI.COMM_WORLD)


def test_structured_box_has_hexahedra(tmp_path: Path) -> None:
    path = step_file(tmp_path / "box.step", lambda occ: occ.addBox(0, 0, 0, 100, 20, 10))
    mesh = read(path, 5e-3, cells="structured")
    assert mesh.domain.topology.cell_name() == "hexahedron"
    assert 20 * 4 * 2 <= cells(mesh) < 2 * 20 * 4 * 2 and volume(mesh) == pytest.approx(2e-5)


def test_inspection_says_whether_curved_cells_work(tmp_path: Path) -> None:
    found = inspect(step_file(tmp_path / "tube.step", tube(2.0)), size=0.03)
    assert found.curved.startswith("works") and 0.0 < found.quality < 1.0


def test_bore_has_no_outer_normal_but_its_end_face_has(tmp_path: Path) -> None:
    path = step_file(tmp_path / "tube.step", tube(8.0))
    found = inspect(path)
    groups = [group for group in found.groups if group.kind == "facets"]
    flat = {g.name for g in groups if np.ptp([g.low[2], g.high[2]]) < 1e-9}
    assert len(groups) == 4 and len(flat) == 2
    for group in groups:
        normal = outer_normal(found, group)
        if group.name not in flat:
            assert normal is None
            continue
        side = 1.0 if group.low[2] > 0.05 else -1.0
        assert normal == pytest.approx([0.0, 0.0, side], abs=1e-9)
