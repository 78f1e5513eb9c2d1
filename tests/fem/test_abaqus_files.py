"""Abaqus and CalculiX files: element types, sets, surfaces, parts, and what is refused or named."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from support import refusal

from fenicsrom.errors import ErrorKind
from fenicsrom.formats import MeshFile, read
from fenicsrom.formats.shapes import SHAPES

NODES = """*HEADING
Two cubes
*Node, nset=NALL
 1, 0., 0., 0.
 2, 1., 0., 0.
 3, 1., 1., 0.
 4, 0., 1.
 5, 0., 0., 1.
 6, 1., 0., 1.
 7, 1., 1., 1.
 8, 0., 1., 1.
 9, 0., 0., 2.
10, 1., 0., 2.
11, 1., 1., 2.
12, 0., 1., 2.
"""
CELLS = "*Element, type=C3D8R, elset=Body\n1, 1,2,3,4, 5,6,7,8\n2, 5,6,7,8, 9,10,11,12\n"


def model(tmp_path: Path, text: str) -> MeshFile:
    """A file read."""
    path = tmp_path / "a.inp"
    path.write_text(text)
    return read(path)


def cells(mesh: MeshFile, name: str, dimension: int) -> int:
    """Number of cells of a group of a dimension."""
    blocks = [block for block in mesh.blocks if SHAPES[block.kind].dimension == dimension]
    return sum(int(block.groups[name].sum()) for block in blocks if name in block.groups)


def facet_corners(mesh: MeshFile, name: str) -> list[list[int]]:
    """Sorted node numbers of the corners of the facets of a group, in a file numbered from 1."""
    found = []
    for block in mesh.blocks:
        if SHAPES[block.kind].dimension == 2 and name in block.groups:
            corners = block.nodes[block.groups[name], : SHAPES[block.kind].corners] + 1
            found += np.sort(corners, axis=1).tolist()
    return sorted(found)


def test_ranges_of_two_and_three_numbers_are_read(tmp_path: Path) -> None:
    sets = (
        "*ELSET, ELSET=both, GENERATE\n1, 2\n*NSET, NSET=low, GENERATE\n1, 4, 1\n9, 11, 2\n"
        "*Nset, nset=all\nlow, 5, 6,\n7, 8\n*Nset, nset=of, elset=both\n"
    )
    mesh = model(tmp_path, NODES + CELLS + sets)
    assert cells(mesh, "both", 3) == 2
    assert list(mesh.node_groups["low"] + 1) == [1, 2, 3, 4, 9, 11]
    assert list(mesh.node_groups["all"] + 1) == [1, 2, 3, 4, 5, 6, 7, 8, 9, 11]
    assert len(mesh.node_groups["of"]) == len(mesh.node_groups["NALL"]) == 12


def test_numbers_of_a_range_that_are_not_in_the_file_are_passed_over(tmp_path: Path) -> None:
    sets = "*NSET, NSET=many, GENERATE\n11, 1000\n*ELSET, ELSET=few\n2, 77\n"
    mesh = model(tmp_path, NODES + CELLS + sets)
    assert list(mesh.node_groups["many"] + 1) == [11, 12] and cells(mesh, "few", 3) == 1


def test_node_set_and_element_set_of_one_name_are_two_groups(tmp_path: Path) -> None:
    mesh = model(tmp_path, NODES + CELLS + "*NSET, NSET=Top\n9,10,11,12\n*Elset, elset=Top\n2\n")
    assert cells(mesh, "Top", 3) == 1 and list(mesh.node_groups["Top"] + 1) == [9, 10, 11, 12]


def test_small_and_capital_letters_mean_the_same_set(tmp_path: Path) -> None:
    mesh = model(tmp_path, NODES + CELLS + "*NSET, nset=Top\n9\n*nset, Nset=TOP\n10\n")
    assert list(mesh.node_groups["Top"] + 1) == [9, 10] and "TOP" not in mesh.node_groups


TRIANGLE = "*NODE\n1,0,0\n2,2,0\n3,0,2\n4,1,0\n5,1,1\n6,0,1\n7,2,2\n8,2,1\n9,1,2\n"


@pytest.mark.parametrize(
    ("name", "row", "kind"),
    [
        ("CPS3", "1,1,2,3", 2),
        ("CPS4R", "1,1,2,7,3", 3),
        ("CPS6", "1,1,2,3,4,5,6", 9),
        ("CPS8", "1,1,2,7,3,4,8,9,6", 16),
        ("CPS8R", "1,1,2,7,3,\n4,8,9,6", 16),
    ],
)
def test_variants_of_plane_elements_are_read(
    tmp_path: Path, name: str, row: str, kind: int
) -> None:
    mesh = model(tmp_path, f"{TRIANGLE}*ELEMENT, TYPE={name}\n{row}\n")
    assert [block.kind for block in mesh.blocks] == [kind] and mesh.not_read == ()


TETRA = "*NODE\n" + "".join(
    f"{k + 1}, {x}, {y}, {z}\n"
    for k, (x, y, z) in enumerate(
        np.array([0, 200, 20, 2, 100, 110, 10, 1, 101, 11])[:, None] // (100, 10, 1) % 10
    )
)


@pytest.mark.parametrize("name", ["C3D10", "C3D10MH"])
def test_tetrahedron_on_two_lines_has_its_nodes_on_its_edges(tmp_path: Path, name: str) -> None:
    mesh = model(tmp_path, f"{TETRA}*ELEMENT, TYPE={name}\n1, 1,2,3,4,5,6,7,\n8,9,10\n")
    (block,) = mesh.blocks
    x = mesh.points[block.nodes[0]]
    for k, (a, b) in enumerate(SHAPES[11].edges):
        assert np.array_equal(x[4 + k], 0.5 * (x[a] + x[b]))


def test_surface_of_element_faces_is_a_facet_group(tmp_path: Path) -> None:
    surface = (
        "*Elset, elset=_Skin_S3, internal\nBody\n*Surface, type=ELEMENT, name=Skin\n"
        "_Skin_S3, S3\n1, S1\n*SURFACE, NAME=N, TYPE=NODE\nNALL\n"
    )
    mesh = model(tmp_path, NODES + CELLS + surface)
    assert facet_corners(mesh, "Skin") == [[1, 2, 3, 4], [1, 2, 5, 6], [5, 6, 9, 10]]
    assert len(mesh.node_groups["N"]) == 12 and mesh.not_read == ()
    assert not any("_Skin_S3" in block.groups for block in mesh.blocks)


TETRA_FACES = [[1, 2, 3], [1, 2, 4], [2, 3, 4], [1, 3, 4]]
CUBE_FACES = [[1, 2, 3, 4], [5, 6, 7, 8], [1, 2, 5, 6], [2, 3, 6, 7], [3, 4, 7, 8], [1, 4, 5, 8]]


@pytest.mark.parametrize(
    ("body", "faces"),
    [(NODES + CELLS, CUBE_FACES), (f"{TETRA}*ELEMENT, TYPE=C3D4\n1, 1,2,3,4\n", TETRA_FACES)],
)
def test_faces_of_cells_are_numbered_as_in_the_manual(
    tmp_path: Path, body: str, faces: list[list[int]]
) -> None:
    surfaces = "".join(f"*SURFACE, NAME=F{k}\n1, S{k}\n" for k in range(1, len(faces) + 1))
    mesh = model(tmp_path, body + surfaces)
    for k, face in enumerate(faces, 1):
        assert facet_corners(mesh, f"F{k}") == [face]


def test_shells_on_facets_are_groups_and_others_are_named(tmp_path: Path) -> None:
    more = (
        "*ELEMENT, TYPE=S4R, ELSET=skin\n11, 1,2,3,4\n12, 1,3,9,10\n*ELEMENT, TYPE=S8\n"
        "13, 1,2,3,4,5,6,7,8\n*ELEMENT, TYPE=MASS, ELSET=m\n14, 1\n15, 2\n"
        "*ELEMENT, TYPE=B31\n16, 1, 2\n*ELEMENT, TYPE=SPRINGA\n17, 1, 2\n*ELSET, ELSET=x\nm\n"
        "*MASS, ELSET=m\n5.\n*TIE, NAME=t\na, b\n*EQUATION\n2\n1,1,1.,2,1,-1.\n*Material, name=s\n"
        "*Boundary\n1, 1, 3\n*STEP\n*STATIC\n*CLOAD\n9,1,1.\n*NODE PRINT\nU\n*END STEP\n"
    )
    mesh = model(tmp_path, NODES + CELLS + more)
    assert facet_corners(mesh, "skin") == [[1, 2, 3, 4]]
    assert set(mesh.not_read) == {"1 S4R element", "1 B31 element", "1 SPRINGA element"}


PARTS = f"""*Part, name=Beam
{NODES.partition("*Node, nset=NALL")[0].partition("*HEADING")[0]}*Node
{NODES.partition("NALL")[2].lstrip()}{CELLS}*Nset, nset=Set-1, generate
1, 4, 1
*Nset, nset=Only
9
*End Part
*Assembly, name=Assembly
*Instance, name=Beam-1, part=Beam
*End Instance
*Instance, name=Beam-2, part=Beam
10., 0., 0.
10., 0., 0., 10., 0., 1., 90.
*End Instance
*Node
1, 5., 5., 5.
*Nset, nset=Set-1, instance=Beam-1
9, 10
*Elset, elset=Set-1, instance=Beam-1
2
*Nset, nset=Mixed
Beam-2.12, Beam-1.Set-1
*End Assembly
"""


def test_instances_are_moved_and_turned(tmp_path: Path) -> None:
    mesh = model(tmp_path, PARTS)
    assert len(mesh.points) == 25 and sum(len(block.nodes) for block in mesh.blocks) == 4
    # node 2 of the second instance: x = 1 about the axis through (10, 0, 0) becomes y = 1
    assert np.allclose(mesh.points[1 + 12 + 1], (10.0, 1.0, 0.0), atol=1e-14)
    assert np.allclose(mesh.points[1 + 12 + 3], (9.0, 0.0, 0.0), atol=1e-14)


def test_sets_of_parts_and_assembly_are_told_apart(tmp_path: Path) -> None:
    mesh = model(tmp_path, PARTS)
    assert list(mesh.node_groups["Set-1"]) == [9, 10]
    assert list(mesh.node_groups["Beam-1.Set-1"]) == [1, 2, 3, 4]
    assert list(mesh.node_groups["Beam-2.Set-1"]) == [13, 14, 15, 16]
    assert list(mesh.node_groups["Mixed"]) == [1, 2, 3, 4, 24]
    assert {"Beam-1.Only", "Beam-2.Only"} <= mesh.node_groups.keys()
    assert cells(mesh, "Set-1", 3) == 1 and any("Beam-1.Set-1" in note for note in mesh.notes)


def test_cylindrical_coordinates_are_converted(tmp_path: Path) -> None:
    text = NODES + "*NODE, SYSTEM=C\n20, 2., 90., 5.\n*NODE\n21, 2., 90., 5.\n" + CELLS
    mesh = model(tmp_path, text)
    assert np.allclose(mesh.points[12], (0.0, 2.0, 5.0)) and mesh.points[13, 0] == 2.0


def test_included_file_is_read(tmp_path: Path) -> None:
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub" / "cells.inc").write_text(CELLS)
    (tmp_path / "top.csv").write_text("9, 10\n11, 12\n")
    more = "*INCLUDE, INPUT=sub/cells.inc\n*NSET, NSET=top, INPUT=top.csv\n"
    mesh = model(tmp_path, NODES + more)
    assert len(mesh.blocks[0].nodes) == 2 and len(mesh.node_groups["top"]) == 4


def test_missing_or_endless_include_is_refused(tmp_path: Path) -> None:
    with refusal(ErrorKind.FILE, file="a.inp", names="nodes.inp"):
        model(tmp_path, "*INCLUDE, INPUT=nodes.inp\n")
    with refusal(ErrorKind.FORMAT, file="a.inp", names="without end"):
        model(tmp_path, "*INCLUDE, INPUT=a.inp\n")


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("*NGEN\n1, 2, 1\n", "*NGEN"),
        ("*ELGEN\n1, 2, 1\n", "*ELGEN"),
        ("*NCOPY, CHANGE NUMBER=1, OLD SET=a, NEW SET=b\n", "*NCOPY"),
        ("*SYSTEM\n1.,0.,0.\n", "*SYSTEM"),
        ("*NODE, SYSTEM=S\n30, 1., 0., 0.\n", "SYSTEM=S"),
        ("*NODE\n1, 0., 0., 0.5\n", "node 1"),
        ("*ELEMENT, TYPE=C3D8R\n1, 1,2,3,4,5,6,7,12\n", "element 1"),
        ("*ELEMENT, TYPE=C3D8\n3, 1,2,3,4,5,6,7,99\n", "99"),
        ("*ELEMENT, TYPE=C3D18\n3, 1,2,3,5,6,7\n", "C3D18"),
        ("*INSTANCE, NAME=i, PART=p\n*END INSTANCE\n", "no part"),
    ],
)
def test_what_cannot_be_honoured_is_refused_by_name(tmp_path: Path, text: str, names: str) -> None:
    with refusal(ErrorKind.FORMAT, file="a.inp", names=names):
        model(tmp_path, NODES + CELLS + text)


def test_node_or_element_given_twice_alike_is_read_once(tmp_path: Path) -> None:
    mesh = model(tmp_path, NODES + "*NODE\n1, 0., 0., 0.\n" + CELLS + CELLS)
    assert len(mesh.points) == 12 and len(mesh.blocks[0].nodes) == 2


def test_axisymmetric_elements_and_surplus_nodes_are_named(tmp_path: Path) -> None:
    mesh = model(tmp_path, f"{TRIANGLE}*ELEMENT, TYPE=CAX4\n1,1,2,7,3\n")
    assert any("CAX4" in entry for entry in mesh.not_read)
    mesh = model(tmp_path, f"{TRIANGLE}*ELEMENT, TYPE=CPS4\n1,1,2,7,3,4,5\n")
    assert any("CPS4" in note for note in mesh.notes) and mesh.blocks[0].nodes.shape == (1, 4)


def test_file_without_cells_is_not_called_damaged(tmp_path: Path) -> None:
    for text in (NODES, NODES + "*ELEMENT, TYPE=B31\n1, 1, 2\n"):
        with refusal(ErrorKind.FORMAT, file="a.inp", names="no cells"):
            model(tmp_path, text)
