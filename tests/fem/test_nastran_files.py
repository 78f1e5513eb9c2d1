"""Nastran files: field formats, continuations, coordinate systems, and what is refused or named."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from support import refusal

from fenicsrom.errors import ErrorKind, SceneError
from fenicsrom.formats import MeshFile, read
from fenicsrom.formats.shapes import SHAPES

PLACES = [(x, y, z) for z in (0.0, 1.0) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))]


def small(*words: object) -> str:
    """A line in small field format."""
    return "".join(f"{word!s:8}" for word in words).rstrip() + "\n"


GRIDS = "".join(small("GRID", k + 1, "", *map(float, x)) for k, x in enumerate(PLACES))
HEXA = small("CHEXA", 1, 7, 1, 2, 3, 4, 5, 6, "+A") + small("+A", 7, 8)


def model(tmp_path: Path, text: str, suffix: str = ".bdf") -> MeshFile:
    """A file with this bulk data read."""
    path = tmp_path / f"a{suffix}"
    path.write_text(f"SOL 103\nCEND\nBEGIN BULK\n{text}ENDDATA\n")
    return read(path)


@pytest.mark.parametrize("suffix", [".nas", ".BDF"])
def test_cube_is_read_with_its_property_as_group(tmp_path: Path, suffix: str) -> None:
    mesh = model(tmp_path, GRIDS + HEXA, suffix)
    assert mesh.blocks[0].kind == 5 and mesh.blocks[0].groups.keys() == {"7"}
    assert np.array_equal(mesh.points[mesh.blocks[0].nodes[0]], PLACES)


@pytest.mark.parametrize(
    "text",
    [
        small("CHEXA", 1, 7, 1, 2, 3, 4, 5, 6) + small("", 7, 8),
        small("chexa", 1, 7, 1, 2, 3, 4, 5, 6) + small("+", 7, 8),
        "CHEXA,1,7,1,2,3,4,5,6\n,7,8\n",
        "CHEXA,1,7,1,2,3,4,5,6,+B\n+B,7,8\n",
        "CHEXA*  1               7               1               2               *C\n"
        "*C      3               4               5               6\n"
        "*       7               8\n",
        "CHEXA\t1\t7\t1\t2\t3\t4\t5\t6\n\t7\t8\n",
    ],
)
def test_every_field_format_and_continuation_is_read(tmp_path: Path, text: str) -> None:
    mesh = model(tmp_path, f"{GRIDS}$ comment\n{text}")
    assert np.array_equal(mesh.blocks[0].nodes, [range(8)])


@pytest.mark.parametrize("text", ["1.5D-3", "+1.5-3", "15.-4"])
def test_reals_without_exponent_letter_are_read(tmp_path: Path, text: str) -> None:
    mesh = model(tmp_path, GRIDS + small("GRID", 9, "", text) + HEXA)
    assert mesh.points[8, 0] == pytest.approx(1.5e-3, rel=1e-15)


def quadratic(kind: str) -> tuple[list[tuple[float, ...]], list[int]]:
    """Places of the nodes of a quadratic element in Nastran's order, and their numbers."""
    x = np.array(PLACES)
    edges = {
        "CHEXA": [
            *((0, 1), (1, 2), (2, 3), (3, 0), (0, 4), (1, 5), (2, 6), (3, 7)),
            *((4, 5), (5, 6), (6, 7), (7, 4)),
        ],
        "CTETRA": [(0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)],
    }[kind]
    corners = x if kind == "CHEXA" else x[[0, 1, 3, 4]]
    places = [*corners, *(0.5 * (corners[a] + corners[b]) for a, b in edges)]
    return [tuple(map(float, place)) for place in places], list(range(1, len(places) + 1))


@pytest.mark.parametrize(("name", "kind"), [("CHEXA", 17), ("CTETRA", 11)])
@pytest.mark.parametrize("missing", [(), (9, 10)])
def test_quadratic_solids_have_their_nodes_on_their_edges(
    tmp_path: Path, name: str, kind: int, missing: tuple[int, ...]
) -> None:
    places, numbers = quadratic(name)
    text = "".join(small("GRID", k + 1, "", *place) for k, place in enumerate(places))
    words = [1, 7, *("" if number in missing else number for number in numbers)]
    lines = [words[k : k + 8] for k in range(0, len(words), 8)]
    text += small(name, *lines[0]) + "".join(small("", *line) for line in lines[1:])
    mesh = model(tmp_path, text)
    (block,) = mesh.blocks
    assert block.kind == kind and bool(mesh.notes) == bool(missing)
    x, shape = mesh.points[block.nodes[0]], SHAPES[kind]
    for k, (a, b) in enumerate(shape.edges):
        assert np.array_equal(x[shape.corners + k], 0.5 * (x[a] + x[b]))


def test_rest_of_the_model_is_named_and_shells_on_facets_are_groups(tmp_path: Path) -> None:
    more = (
        small("CQUAD4", 11, 3, 1, 2, 3, 4)
        + small("CQUAD4", 12, 3, 1, 3, 6, 8)
        + small("CBAR", 13, 4, 1, 2)
        + small("CONM2", 14, 1, "", 5.0)
        + small("RBE2", 15, 1, 123456, 2, 3)
        + small("CBUSH", 16, 5, 1, 2)
        + small("CYSYM", 24, "ROT")
        + small("CYJOIN", 1, "", 1, 4, 5, 8)
        + small("CYJOIN", 2, "", 2, 3, 6, 7)
        + small("MAT1", 1, 2.1e11, "", 0.3)
        + small("SPC1", 5, 123, 1, "THRU", 4)
        + small("SPC", 6, 8, 123)
    )
    mesh = model(tmp_path, GRIDS + HEXA + more)
    assert mesh.not_read == (
        "1 CBAR element",
        "1 CQUAD4 element",
        "1 CBUSH (springs lie between a node and the ground)",
        "1 CYSYM (give [cyclic])",
        "2 CYJOIN (give [cyclic])",
    )
    assert any(what.startswith("1 RBE2") for what in mesh.physics.not_taken)
    facets = [block for block in mesh.blocks if "3" in block.groups]
    assert [block.nodes.tolist() for block in facets] == [[[0, 1, 2, 3]]]
    groups = {name: nodes.tolist() for name, nodes in mesh.node_groups.items()}
    assert (groups["SPC 5"], groups["SPC 6"]) == ([0, 1, 2, 3], [7])
    assert (groups["CYJOIN 1"], groups["CYJOIN 2"]) == ([0, 3, 4, 7], [1, 2, 5, 6])


@pytest.mark.parametrize("card", ["CBEAM", "CONROD"])
def test_grids_of_a_line_stand_behind_its_property(tmp_path: Path, card: str) -> None:
    """A grid that the file does not hold is named, wherever the card has it."""
    first = (3,) if card == "CONROD" else (4, 3)
    assert model(tmp_path, GRIDS + HEXA + small(card, 13, *first, 8, 8, 8)).not_read == (
        f"1 {card} element",
    )
    with pytest.raises(SceneError, match=f"{card} 13 refers to GRID 99"):
        model(tmp_path, GRIDS + HEXA + small(card, 13, *first[:-1], 99, 1))


def test_plane_elements_make_a_plane_mesh(tmp_path: Path) -> None:
    mesh = model(tmp_path, GRIDS + small("CQUAD4", 1, 3, 1, 2, 3, 4) + small("CBAR", 2, 9, 4, 1))
    assert [block.kind for block in mesh.blocks] == [3, 1]
    assert mesh.blocks[1].groups.keys() == {"9"} and mesh.not_read == ()
    assert ["do not bend" in note for note in mesh.notes] == [True]


CYLINDER = small("CORD2C", 5, 0, 1.0, 0.0, 0.0, 1.0, 0.0, 1.0) + small("", 2.0, 0.0, 0.0)
SPHERE = small("CORD2S", 6, 0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0) + small("", 1.0, 0.0, 0.0)
SHIFTED = small("CORD2R", 7, 5, 1.0, 90.0, 0.0, 1.0, 90.0, 1.0) + small("", 2.0, 90.0, 0.0)
BY_GRIDS = small("CORD1R", 8, 2, 6, 3)


@pytest.mark.parametrize(
    ("system", "place", "expected", "default"),
    [
        (5, (2.0, 90.0, 3.0), (1.0, 2.0, 3.0), False),
        (5, (2.0, 90.0, 3.0), (1.0, 2.0, 3.0), True),
        (6, (2.0, 90.0, 90.0), (0.0, 2.0, 0.0), False),
        (6, (2.0, 0.0, 45.0), (0.0, 0.0, 2.0), True),
        (7, (1.0, 2.0, 3.0), (-1.0, 2.0, 3.0), False),
        (8, (1.0, 2.0, 3.0), (-1.0, 1.0, 3.0), False),
    ],
)
def test_coordinate_systems_are_honoured(
    tmp_path: Path, system: int, place: tuple, expected: tuple, default: bool
) -> None:
    basic = "".join(small("GRID", k + 1, 0, *map(float, x)) for k, x in enumerate(PLACES))
    own = small("GRDSET", "", system) if default else ""
    own += small("GRID", 9, "" if default else system, *place)
    mesh = model(tmp_path, CYLINDER + SPHERE + SHIFTED + BY_GRIDS + basic + own + HEXA)
    assert np.allclose(mesh.points[8], expected, atol=1e-14)
    assert np.array_equal(mesh.points[:8], PLACES)


def test_included_files_are_read(tmp_path: Path) -> None:
    (tmp_path / "cells.blk").write_text(HEXA)
    assert len(model(tmp_path, GRIDS + "INCLUDE 'cells.blk'\n").blocks[0].nodes) == 1
    assert len(model(tmp_path, GRIDS + "include 'cells\n.blk'\n").blocks[0].nodes) == 1
    with refusal(ErrorKind.FILE, file="a.bdf", names="other.blk"):
        model(tmp_path, GRIDS + "INCLUDE 'other.blk'\n")


@pytest.mark.parametrize(
    ("text", "names"),
    [
        (small("CPENTA", 2, 7, 1, 2, 3, 5, 6), "CPENTA"),
        (small("GRID", 1, "", 0.0, 0.0, 0.5), "GRID 1"),
        (small("GRID", 9, 44, 0.0, 0.0, 0.5), "coordinate system 44"),
        (small("CTETRA", 3, 7, 1, 2, 3, 99), "GRID 99"),
        (small("=", "*1", "="), "replication"),
        ("BEGIN SUPER=1\n", "superelements"),
    ],
)
def test_what_cannot_be_honoured_is_refused_by_name(tmp_path: Path, text: str, names: str) -> None:
    text = small("CHEXA", 1, 7, 1, 2, 3, 4, 5, 6, "+A") + small("+A", 7, 8, *[""] * 6, "+B") + text
    with refusal(ErrorKind.FORMAT, file="a.bdf", names=names):
        model(tmp_path, GRIDS + text)
