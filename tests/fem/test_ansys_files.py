"""ANSYS archives: blocks, repeated nodes, components, and what is refused or named."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from support import refusal

from fenicsrom.errors import ErrorKind
from fenicsrom.formats import MeshFile, read
from fenicsrom.formats.shapes import SHAPES

CORNERS = np.array([(x, y, z) for z in (0, 1) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))])
PAIRS = [(0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4)] + [
    (k, k + 4) for k in range(4)
]
PLACES = np.concatenate([CORNERS, [0.5 * (CORNERS[a] + CORNERS[b]) for a, b in PAIRS]])
CUBE = list(range(1, 21))
TETRA = [1, 2, 4, 4, 5, 5, 5, 5, 9, 21, 4, 12, 5, 5, 5, 5, 17, 22, 23, 23]
"""The corners 1, 2, 4, 5 of a tetrahedron as a hexahedron of 20 nodes with repeated ones."""


def archive(elements: list[tuple[int, list[int]]], more: str = "") -> str:
    """An archive with the nodes of a cube of 20 nodes, and elements of these types."""
    extra = [(0.5, 0.5, 0.0), (0.5, 0.0, 0.5), (0.0, 0.5, 0.5)]
    text = "/PREP7\nET,1,186\nET,2,187\nET,3,185\nET,4,181\nET,5,14\nET,6,183\n"
    text += "NBLOCK,6,SOLID,23,23\n(3i9,6e21.13e3)\n"
    for k, place in enumerate([*PLACES, *extra]):
        shown = "".join(f"{value:21.13E}" for value in place)
        text += f"{k + 1:9d}{0:9d}{0:9d}{shown.rstrip()}\n"
    text += "N,R5.3,LOC,       -1,\nEBLOCK,19,SOLID,9,9\n(19i9)\n"
    for number, (type_, nodes) in enumerate(elements, 1):
        row = [1, type_, 1, 1, 0, 0, 0, 0, len(nodes), 0, number, *nodes]
        text += "".join(f"{value:9d}" for value in row[:19]) + "\n"
        if row[19:]:
            text += "".join(f"{value:9d}" for value in row[19:]) + "\n"
    return text + f"{-1:9d}\n{more}FINISH\n"


def model(tmp_path: Path, text: str, suffix: str = ".cdb") -> MeshFile:
    """A file read."""
    path = tmp_path / f"a{suffix}"
    path.write_text(text)
    return read(path)


@pytest.mark.parametrize(
    ("type_", "nodes", "kind"),
    [
        (1, CUBE, 17),
        (3, CUBE[:8], 5),
        (1, [*CUBE[:8], *[0] * 12], 5),
        (1, [*CUBE[:8], 0, *CUBE[9:]], 17),
        (1, TETRA, 11),
        (2, [1, 2, 4, 5, 9, 21, 12, 17, 22, 23], 11),
        (6, [1, 2, 3, 4, 9, 10, 11, 12], 16),
    ],
)
def test_cells_have_their_nodes_on_their_edges(
    tmp_path: Path, type_: int, nodes: list[int], kind: int
) -> None:
    mesh = model(tmp_path, archive([(type_, nodes)]), ".dat" if type_ == 2 else ".cdb")
    (block,) = mesh.blocks
    assert block.kind == kind
    x, shape = mesh.points[block.nodes[0]], SHAPES[kind]
    for k in range(shape.nodes - shape.corners):
        a, b = shape.edges[k]
        assert np.allclose(x[shape.corners + k], 0.5 * (x[a] + x[b]), atol=1e-15)


def test_components_are_groups_and_the_rest_is_named(tmp_path: Path) -> None:
    more = (
        "CMBLOCK,ROOT,NODE,       3\n(8i10)\n         1        -4         8\n"
        "CMBLOCK,BODY,ELEM,       1  ! users\n(8i10)\n         1\n"
        "CYCLIC,24,0.0,0,CYC\nCYCOPT,NODDIA,2\n"
        "CP,1,UX,1,2\nACEL,  0.00000000    ,  0.00000000    \nMPDATA,R5.0, 1,EX, 1, 1, 2.1E11\n"
        "MPDATA,R5.0, 1,DENS, 1, 1, 7850.0, 7800.0\n"
    )
    mesh = model(tmp_path, archive([(3, CUBE[:8]), (4, [1, 2, 3, 4]), (5, [1, 2])], more))
    assert list(mesh.node_groups["ROOT"]) == [0, 1, 2, 3, 7]
    assert mesh.blocks[0].groups.keys() == {"BODY"}
    reason = "a scene has no equations between displacements"
    cyclic = "1 CYCLIC (give [cyclic])", "1 CYCOPT (give [cyclic])"
    assert mesh.not_read == (*cyclic, f"1 CP ({reason})", "1 MP,DENS")
    assert any(what.startswith("springs") for what in mesh.physics.not_taken)


@pytest.mark.parametrize(
    ("text", "names"),
    [
        (archive([(1, CUBE)])[:700], "damaged"),
        ("/PREP7\nN,1,0,0,0\nE,1,2\n", "CDWRITE"),
        (archive([(3, CUBE[:8]), (3, CUBE[:8])]), "1 and 2"),
    ],
)
def test_damaged_or_unsupported_archive_is_refused(tmp_path: Path, text: str, names: str) -> None:
    with refusal(ErrorKind.FORMAT, file="a.cdb", names=names):
        model(tmp_path, text)
