"""Contacts, ties and pre-tension sections of Abaqus and CalculiX decks: two cubes in a row."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("dolfinx")
from mpi4py import MPI
from test_deck_physics import PLACES

from fenicsrom import formats
from fenicsrom.fem.mesh.inspection import inspect
from fenicsrom.fem.mesh.mesh import build_mesh
from fenicsrom.fem.solid.solid import solid_of
from fenicsrom.formats.mesh_file import DeckJoint, MeshFile
from fenicsrom.post.studies.starter import starter_scene
from fenicsrom.scene import read_scene

CUBES = (
    "*NODE\n"
    + "".join(
        f"{10 * b + k}, {b + x}, {y}, {z}\n"
        for b in (0, 1)
        for k, (x, y, z) in enumerate(PLACES, 1)
    )
    + """99, 5, 0, 0
*ELEMENT, TYPE=C3D8, ELSET=EALL
1, 1,2,3,4,5,6,7,8
2, 11,12,13,14,15,16,17,18
*NSET, NSET=FIX
1, 4, 5, 8
*NSET, NSET=GUIDE
12, 13, 16, 17
*SURFACE, NAME=First
1, S4
*SURFACE, NAME=Second
2, S6
*SURFACE, NAME=Nodes, TYPE=NODE
11
14
15
18
*SURFACE, NAME=Few, TYPE=NODE
11
14
*MATERIAL, NAME=STEEL
*ELASTIC
2.1e5, 0.0
*DENSITY
7.85e-9,
*SOLID SECTION, ELSET=EALL, MATERIAL=STEEL
"""
)
STEP = """*BOUNDARY
FIX, 1, 3
GUIDE, 2, 3
*STEP
*STATIC
*DLOAD
2, P4, 10.
"""
PAIR = """*SURFACE INTERACTION, NAME=Steel on steel
*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR
1e5,
*FRICTION
0.2, 5e4
*CONTACT PAIR, INTERACTION=STEEL ON STEEL, TYPE=SURFACE TO SURFACE
SECOND, First
"""


def deck(folder: Path, joints: str, step: str = STEP) -> tuple[Path, MeshFile]:
    """The path and the content of a deck of both cubes."""
    path = folder / "cubes.inp"
    path.write_text(f"{CUBES}{joints}{step}*END STEP\n")
    return path, formats.read(path)


@pytest.mark.parametrize(
    ("joints", "expected"),
    [
        ("*TIE, NAME=T, POSITION TOLERANCE=0.1\nNodes, First\n", {"tied": True, "reach": 0.1}),
        ("*SURFACE, TYPE=NODE, NAME=NODES\nnodes, 1.\n*TIE, NAME=T\nNodes, First\n",
         {"tied": True}),
        ("*CONTACT PAIR, TIED\nSecond, First\n", {"tied": True}),
        (PAIR, {"friction": 0.2, "normal": 1e5, "tangential": 5e4}),
        (PAIR.replace("LINEAR", "TIED"), {"tied": True, "friction": 0.2, "normal": 1e5,
                                          "tangential": 5e4}),
        ("*CONTACT PAIR, INTERACTION=I, ADJUST=Nodes\nSecond, First\n"
         "*SURFACE INTERACTION, NAME=I\n*FRICTION\n0.3\n", {"friction": 0.3, "shut": True}),
        ("*CONTACT PAIR, INTERACTION=I, ADJUST=0.0\nSecond, First\n", {}),  # shuts no gap
        ("*SURFACE INTERACTION, NAME=I\n*FRICTION, ROUGH\n*CONTACT PAIR, INTERACTION=I\n"
         "Second, First\n", {"friction": 1e3}),
    ],
)  # fmt: skip
def test_deck_gives_contacts_and_ties(joints: str, expected: dict, tmp_path: Path) -> None:
    found = deck(tmp_path, joints)[1]
    (joint,) = found.physics.joints
    group = "Nodes" if "Nodes, First" in joints else "Second"
    assert joint == DeckJoint(joint.name, group, "First", **{"tied": False} | expected)
    assert found.not_read == () == found.physics.not_taken


@pytest.mark.parametrize(
    ("joints", "said"),
    [
        ("*TIE, NAME=T\nSecond, Absent\n", "the surface Absent has no facets"),
        ("*CONTACT PAIR, INTERACTION=I\nFirst\n", "a surface touches itself"),
        ("*TIE, NAME=T, CYCLIC SYMMETRY\nSecond, First\n", "give [cyclic]"),
        ("*CONTACT PAIR, ADJUST=0.1\nSecond, First\n", "gap = 0.0 closes larger gaps, too"),
        ("*PRE-TENSION SECTION, SURFACE=First, NODE=99\n", "the pre-tension 500 of the section"),
        (f"{PAIR}*CONTACT PAIR\n,\n", "a surface touches itself"),
    ],
)
def test_joint_that_a_scene_cannot_state_is_named(joints: str, said: str, tmp_path: Path) -> None:
    step = STEP + ("*CLOAD\n99, 1, 500\n" if "PRE-TENSION" in joints else "")
    found = deck(tmp_path, joints, step)[1]
    assert any(said in what for what in found.physics.not_taken)


def test_interaction_that_is_not_read_is_named(tmp_path: Path) -> None:
    joints = PAIR.replace("LINEAR", "EXPONENTIAL").replace("*FRICTION", "*FRICTION, ANISOTROPIC")
    found = deck(tmp_path, joints)[1]
    assert {what.partition(" ")[0] for what in found.not_read} == {"*SURFACE", "*FRICTION"}
    (joint,) = found.physics.joints
    assert (joint.normal, joint.friction) == (None, 0.0)


def test_surface_without_whole_facets_is_named_in_the_starter_scene(tmp_path: Path) -> None:
    found = inspect(deck(tmp_path, "*TIE, NAME=T\nFew, First\n")[0])
    text = starter_scene(found, tmp_path)
    assert "[[ties]]" not in text and "no whole facet lies on the surface Few" in text


def archive(folder: Path, *more: str, symmetric: bool = False) -> MeshFile:
    """The content of an ANSYS archive of both cubes with a contact pair of the real constants 5."""
    high, low = [12, 13, 17, 16], [21, 24, 28, 25]
    every = [(1, 1, 1, range(11, 19)), (1, 1, 1, range(21, 29)), (2, 2, 5, low), (2, 3, 5, high)]
    every += [(2, 2, 6, high), (2, 3, 6, low)] if symmetric else []
    lines = ["ET,1,185", "ET,2,174", "ET,3,170", "NBLOCK,6,SOLID", "(3i9,6e21.13e3)"]
    lines += [
        f"{10 + 10 * b + k:9d}{0:9d}{0:9d}{b + x:21.13E}{y:21.13E}{z:21.13E}"
        for b in (0, 1)
        for k, (x, y, z) in enumerate(PLACES, 1)
    ]
    lines += ["N,R5.3,LOC,       -1,", "EBLOCK,19,SOLID", "(19i9)"]
    for label, (material, type_, real, nodes) in enumerate(every, 1):
        head = (material, type_, real, 1, 0, 0, 0, 0, len(nodes), 0, label)
        lines.append("".join(f"{n:9d}" for n in (*head, *nodes)))
    lines += ["       -1", "MP,EX,1,2.1e5", "MP,PRXY,1,0", "MP,MU,2,0.25", *more]
    (folder / "cubes.cdb").write_text("\n".join([*lines, ""]))
    return formats.read(folder / "cubes.cdb")


@pytest.mark.parametrize(
    ("more", "expected"),
    [
        ([], {"friction": 0.25}),
        (["R,5,0,0,-1e5,0.1", "KEYOPT,2,9,1"], {"friction": 0.25, "normal": 1e5, "shut": True}),
        (["R,5,0,0,-1e5,0.1", "RMORE,0,0,1e20,0,1,-2e4"],
         {"friction": 0.25, "normal": 1e5, "tangential": 2e4}),
        (["RLBLOCK,1,5,5,13", "(2i8,6g16.9)", "(7g16.9)", "5 13 0 0 -1e5 0 0 0",
          "0 0 1e20 0 1 -2e4 0"], {"friction": 0.25, "normal": 1e5, "tangential": 2e4}),
        (["KEYOPT,2,12,5"], {"friction": 0.25, "tied": True}),
        (["KEYOPT,2,12,1"], {"friction": 1e3}),
    ],
)  # fmt: skip
def test_archive_gives_contact_pairs(more: list[str], expected: dict, tmp_path: Path) -> None:
    for symmetric in (False, True):
        mesh = archive(tmp_path, *more, symmetric=symmetric)
        (joint,) = mesh.physics.joints
        named = {"tied": False} | expected
        assert joint == DeckJoint("contact pair 5", "contact 5", "target 5", **named)
        assert mesh.not_read == () == mesh.physics.not_taken
        sides = {name for block in mesh.blocks for name in block.groups}
        assert sides >= {"contact 5", "target 5"}


NASTRAN = """BSURFS,1,,,,1,2,3,6
BSURFS,2,,,,2,21,24,25
BCTSET,100,2,1,0.2,0.,0.1
BCTSET,101,2,1,0.9
BGSET,200,2,1,0.3
BGSET,200,2,7
BCTPARM,100,PENN,10.
"""


def test_nastran_gives_the_contacts_and_ties_of_the_case(tmp_path: Path) -> None:
    places = [(20 * b + k, b + x, y, z)
              for b in (0, 1) for k, (x, y, z) in enumerate(PLACES, 1)]  # fmt: skip
    text = "SOL 101\nCEND\nBCSET = 100\nBGSET = 200\nBEGIN BULK\n"
    text += "".join(f"GRID,{n},,{x}.,{y}.,{z}.\n" for n, x, y, z in places)
    text += "CHEXA,1,3,1,2,3,4,5,6,+\n+,7,8\nCHEXA,2,3,21,22,23,24,25,26,+\n+,27,28\n"
    whole = f"{text}PSOLID,3,1\nMAT1,1,2.1+5,,0.\n{NASTRAN}ENDDATA\n"
    (tmp_path / "cubes.bdf").write_text(whole)
    mesh = formats.read(tmp_path / "cubes.bdf")
    assert mesh.physics.joints == (
        DeckJoint("BCTSET 100", "surface 2", "surface 1", tied=False, reach=0.1, friction=0.2),
        DeckJoint("BGSET 200", "surface 2", "surface 1", tied=True, reach=0.3),
    )
    said = " ".join([*mesh.not_read, *mesh.physics.not_taken])
    assert "BCTPARM" in said and "BCTSET of the set 101" in said and "surface 7 has no" in said
    (tmp_path / "cubes.bdf").write_text(re.sub("B[CG]SET = .*\n", "", whole))
    assert not formats.read(tmp_path / "cubes.bdf").physics.joints  # nor does Nastran use them
    facets = {name: block for block in mesh.blocks for name in block.groups if "surface" in name}
    assert {name: set(mesh.points[of.nodes, 0].ravel()) for name, of in facets.items()} == {
        "surface 1": {1.0},
        "surface 2": {1.0},
    }


def test_what_a_pair_of_an_archive_cannot_have_is_named(tmp_path: Path) -> None:
    found = archive(tmp_path, "KEYOPT,2,12,4").physics
    assert any("no separation" in what for what in found.not_taken) and found.joints
    found = archive(tmp_path, "R,5,0,0,1.", "RMORE,0,0,0,-.02").physics
    assert any("CNOF = -0.02" in what for what in found.not_taken) and found.joints


@pytest.mark.slow
@pytest.mark.parametrize(
    ("joints", "gives"),
    [
        ("*TIE, NAME=T\nNodes, First\n", 2e-3),
        (PAIR, 1e-4),
        ("*CONTACT PAIR, INTERACTION=I\nSecond, First\n", 10.0 / 2.1e6),
    ],
    ids=["tie", "linear contact", "rigid contact"],
)
def test_starter_scene_of_a_deck_moves_as_the_deck_means(
    joints: str, gives: float, tmp_path: Path
) -> None:
    """Reference: two pressed bars of a deck, tied and in contact | closed form |
    0.0952, 0.1952 µm | 0.08, 0.003 % | 0.2 %, 0.02 %"""
    path = deck(tmp_path, joints)[0]
    scene_file = tmp_path / "cubes.toml"
    text = starter_scene(inspect(path), tmp_path).replace("[basis]", "[time]\nduration = 1.0\n"
        'step = 0.1\n\n[probe]\ngroup = "GUIDE"\n\n[basis]')  # fmt: skip
    scene_file.write_text(text)
    scene = read_scene(scene_file)
    body = solid_of(scene, build_mesh(scene.geometry, MPI.COMM_WORLD))
    moved = np.asarray(body.probe_rows @ body.equilibrium)[0]
    tied = "TIE" in joints
    wanted = -1e-3 * (2.0 * 10.0 / 2.1e5 + (0.0 if tied else gives))
    assert moved == pytest.approx(wanted, rel=gives if tied else 2e-4)
