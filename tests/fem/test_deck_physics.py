"""Materials, supports, masses, springs and loads of decks: the same cube in three formats."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from fenicsrom import formats
from fenicsrom.formats.mesh_file import DeckLoad, DeckMaterial, Physics
from fenicsrom.notes import note_of

PLACES = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]

ABAQUS = (
    "*NODE\n"
    + "".join(f"{k}, {x}, {y}, {z}\n" for k, (x, y, z) in enumerate(PLACES, 1))
    + """*ELEMENT, TYPE=C3D8, ELSET=EALL
1, 1,2,3,4,5,6,7,8
*ELEMENT, TYPE=MASS, ELSET=EM
2, 7
*SPRING, ELSET=SX
1
90.
*ELEMENT, TYPE=SPRING1, ELSET=SX
3, 6
*ELEMENT, TYPE=SPRING1, ELSET=SZ
5, 6
*NSET, NSET=FIX
1, 4, 5, 8
*MATERIAL, NAME=Steel
*ELASTIC
2.1e5, 0.3
*DENSITY
7.85e-9,
*SOLID SECTION, ELSET=EALL, MATERIAL=STEEL
*MASS, ELSET=EM
1e-4
*SPRING, ELSET=SZ
3
100.
*BOUNDARY
FIX, 1, 3
2, 3
*STEP
*STATIC
*CLOAD
7, 2, -5.
*DLOAD
EALL, GRAV, 9810., 0., 0., -1.
*END STEP
"""
)

NASTRAN = (
    "SOL 101\nCEND\nSPC = 1\nLOAD = 9\nBEGIN BULK\n"
    + "".join(f"GRID,{k},,{x}.,{y}.,{z}.\n" for k, (x, y, z) in enumerate(PLACES, 1))
    + """CHEXA,1,3,1,2,3,4,5,6,+
+,7,8
PSOLID,3,1
MAT1,1,2.1+5,,.3,7.85-9
CONM2,2,7,,1.-4
CELAS1,3,8,6,1
PELAS,7,80.,,,8,90.
CELAS2,5,100.,,,6,3
SPC1,1,123,1,4,5,8
SPC1,1,3,2
SPC1,2,3,3
FORCE,9,7,,5.,0.,-1.,0.
GRAV,9,,9810.,0.,0.,-1.
ENDDATA
"""
)

ANSYS = (
    "/PREP7\nET,1,185\nET,2,21\nET,3,14\nKEYOP,3,2,1\nET,4,14\nNBLOCK,6,SOLID\n(3i9,6e21.13e3)\n"
    + "".join(
        f"{k:9d}{0:9d}{0:9d}{x:21.13E}{y:21.13E}{z:21.13E}\n"
        for k, (x, y, z) in enumerate(PLACES, 1)
    )
    + "N,R5.3,LOC,       -1,\nEBLOCK,19,SOLID\n(19i9)\n"
    + "".join(f"{n:9d}" for n in (1, 1, 1, 1, 0, 0, 0, 0, 8, 0, 1, *range(1, 9)))
    + "\n"
    + "".join(f"{n:9d}" for n in (1, 2, 7, 1, 0, 0, 0, 0, 1, 0, 2, 7))
    + "\n"
    + "".join(f"{n:9d}" for n in (1, 3, 8, 1, 0, 0, 0, 0, 2, 0, 3, 1, 6))
    + "\n"
    + "".join(f"{n:9d}" for n in (1, 4, 9, 1, 0, 0, 0, 0, 2, 0, 4, 6, 2))
    + """
       -1
MPTEMP,R5.0, 1, 1,  0.00000000    ,
MPDATA,R5.0, 1,EX  ,       1, 1,  210000.000    ,
MPDATA,R5.0, 1,PRXY,       1, 1, 0.300000000    ,
MPDATA,R5.0, 1,DENS,       1, 1, 7.850000000E-09,
R,7,1e-4
R,8,90.
R,9,100.,0.
D,       1,ALL ,  0.000000000    ,  0.000000000
D,       4,ALL ,  0.000000000    ,  0.000000000
D,       5,ALL ,  0.000000000    ,  0.000000000
D,       8,ALL ,  0.000000000    ,  0.000000000
D,       2,UZ  ,  0.000000000    ,  0.000000000
F,       7,FY  ,  -5.00000000    ,  0.000000000
ACEL,  0.00000000    ,  0.00000000    ,  9810.00000
"""
)


def physics(path: Path, text: str) -> tuple[Physics, dict[str, list[int]]]:
    """What a file holds besides its mesh, and its groups of nodes."""
    path.write_text(text)
    mesh = formats.read(path)
    return mesh.physics, {name: sorted(nodes) for name, nodes in mesh.node_groups.items()}


@pytest.mark.parametrize(
    ("name", "text"), [("a.inp", ABAQUS), ("a.bdf", NASTRAN), ("a.cdb", ANSYS)]
)
def test_deck_brings_what_it_holds(tmp_path: Path, name: str, text: str) -> None:
    found, groups = physics(tmp_path / name, text)
    (material,) = found.materials
    assert (material.young, material.poisson, material.density) == (2.1e5, 0.3, 7.85e-9)
    assert material.group is None
    held = {tuple(groups[name]): components for name, components in found.supports}
    assert held == {(0, 3, 4, 7): (0, 1, 2), (1,): (2,)}
    assert found.masses == (((1.0, 1.0, 1.0), 1e-4),)
    assert found.springs == (((1.0, 0.0, 1.0), 0, 90.0), ((1.0, 0.0, 1.0), 2, 100.0))
    assert DeckLoad("force", (0.0, -5.0, 0.0), (1.0, 1.0, 1.0)) in found.loads
    (gravity,) = [load for load in found.loads if load.kind == "acceleration"]
    assert np.allclose(gravity.vector, (0.0, 0.0, -9810.0))
    left = ("1 SPC1 of the set 2, which the case does not use",)
    assert found.not_taken == (left if name == "a.bdf" else ())


def test_each_of_several_materials_has_a_group(tmp_path: Path) -> None:
    nodes = "".join(f"{k}, {x + 1}, {y}, {z}\n" for k, (x, y, z) in enumerate(PLACES, 11) if x)
    brass = (
        "*ELEMENT, TYPE=C3D8, ELSET=B\n9, 2,12,13,3,6,16,17,7\n"
        "*MATERIAL, NAME=Rubber\n*HYPERELASTIC\n1., 2.\n"
        "*MATERIAL, NAME=Brass\n*ELASTIC\n1e5, 0.35\n*SOLID SECTION, ELSET=B, MATERIAL=Brass\n"
    )
    text = ABAQUS.replace("*NODE\n", f"*NODE\n{nodes}").replace("*BOUNDARY", f"{brass}*BOUNDARY")
    found, _ = physics(tmp_path / "a.inp", text)
    assert set(found.materials) == {
        DeckMaterial("Steel", 2.1e5, 0.3, 7.85e-9, "EALL"),
        DeckMaterial("Brass", 1e5, 0.35, None, "B"),
    }


def test_what_a_scene_cannot_state_is_named(tmp_path: Path) -> None:
    text = ABAQUS.replace("*SPRING, ", "*SPRING, NONLINEAR, ").replace("2, 3\n", "2, 3, 3, 0.1\n")
    text = text.replace("*STATIC\n", "*STATIC\n*DSLOAD\nTOP, TRVEC, 1.\n")
    found, _ = physics(tmp_path / "a.inp", text.replace("7, 2, -5.", "7, 5, -5."))
    assert len(found.not_taken) == 4 and not found.springs
    assert any("moment" in what for what in found.not_taken)


@pytest.mark.parametrize(("load", "count"), [("*CLOAD", 0), ("*CLOAD, AMPLITUDE=A", 1)])
def test_amplitude_casts_doubt_by_the_loads_that_have_it(
    load: str, count: int, tmp_path: Path
) -> None:
    text = ABAQUS.replace("*STEP\n", "*AMPLITUDE, NAME=A\n0., 0., 1., 3.\n*STEP\n")
    (tmp_path / "a.inp").write_text(text.replace("*CLOAD", load))
    found = formats.read(tmp_path / "a.inp")
    assert found.not_read == () and len(found.physics.not_taken) == count


@pytest.mark.parametrize(
    ("load", "reason"),
    [
        ("*DLOAD\nEALL, CENTRIF, 1., 0, 0, 0, 0, 0, 1.\n", "[rotation]"),
        ("*DLOAD\nEALL, P7, 1.\n", "no such face"),
    ],
)
def test_load_that_is_not_taken_is_named_with_its_reason(
    tmp_path: Path, load: str, reason: str
) -> None:
    step = "*STEP\n*STATIC\n"
    found, _ = physics(tmp_path / "a.inp", ABAQUS.replace(step, step + load))
    (left,) = found.not_taken
    assert reason in left and not any(load.kind == "pressure" for load in found.loads)


def test_shear_modulus_gives_poissons_ratio(tmp_path: Path) -> None:
    found, _ = physics(tmp_path / "a.bdf", NASTRAN.replace("2.1+5,,.3,", "2.1+5,8.4+4,,"))
    assert found.materials[0].poisson == pytest.approx(0.25)
    text = NASTRAN.replace("CONM2", "PARAM,WTMASS,2.\nCONM2")
    found, _ = physics(tmp_path / "a.bdf", text)
    assert found.masses[0][1] == 2e-4 and found.materials[0].density == 1.57e-8


def nastran(tmp_path: Path, case: str, bulk: str) -> tuple[Physics, dict[str, list[int]]]:
    """What the cube holds without supports, springs and loads, but with these entries."""
    rest = NASTRAN[NASTRAN.index("GRID") : NASTRAN.index("CONM2")]
    return physics(tmp_path / "a.bdf", f"SOL 101\nCEND\n{case}BEGIN BULK\n{rest}{bulk}ENDDATA\n")


def held(found: Physics, groups: dict[str, list[int]]) -> dict[tuple, tuple]:
    """Components that are held, by the nodes of the groups."""
    return {tuple(groups[str(name)]): components for name, components in found.supports}


@pytest.mark.parametrize("case", ["  spc=7\nSUBCASE 1\n LOAD = 8\n", ""])
def test_combined_sets_are_taken_with_their_factors(tmp_path: Path, case: str) -> None:
    """SPCADD and LOAD contain sets, which may be combinations themselves."""
    bulk = (
        "SPCADD,7,1,6\nSPCADD,6,3\nSPC1,1,123,1,4,5,8\nSPC1,3,3,2\n"
        "LOAD,8,2.,3.,1,.5,5\nLOAD*,5,-1.,4.,2\nFORCE,1,7,,5.,0.,-1.,0.\nFORCE,2,6,,1.,1.,0.,0.\n"
    )
    found, groups = nastran(tmp_path, case, bulk)
    assert held(found, groups) == {(0, 3, 4, 7): (0, 1, 2), (1,): (2,)}
    assert {load.vector for load in found.loads} == {(0.0, -30.0, 0.0), (-4.0, 0.0, 0.0)}
    assert not found.not_taken


def test_only_the_first_subcase_is_taken_and_the_others_are_named(tmp_path: Path) -> None:
    case = "SPC = 1\nSUBCASE 1\n LOAD = 1\nSUBCASE 2\n SPC = 3\n LOAD = 2\n"
    bulk = "SPC1,1,123,1\nSPC1,3,3,2\nFORCE,1,7,,5.,0.,1.,0.\nFORCE,2,6,,1.,1.,0.,0.\n"
    found, groups = nastran(tmp_path, case, bulk)
    assert held(found, groups) == {(0,): (0, 1, 2)} and len(found.loads) == 1
    assert len(found.not_taken) == 3 and "subcases" in found.not_taken[0]


def test_set_that_a_case_does_not_select_is_not_used(tmp_path: Path) -> None:
    bulk = "SPC1,1,123,1\nFORCE,6,7,,5.,0.,1.,0.\n"
    found, _ = nastran(tmp_path, "METHOD = 3\nSPC = 1\n", bulk)
    assert found.supports and not found.loads and len(found.not_taken) == 1


CENTRE = "GRID,20,,-1.,.5,.5\nGRID,21,,-2.,.5,.5\n"
FACE = "1,4,5,8"


@pytest.mark.parametrize(
    "bulk",
    [
        f"RBE2,50,20,123456,{FACE}\nSPC1,1,123456,20\n",
        f"RBE2,50,20,123,{FACE}\nRBAR,51,21,20,123456\nSPC,1,21,123456,0.\n",
        f"RBE2,50,20,123,{FACE},1.-6\nGRID,22,,-3.,.5,.5,,123456\nRBAR,51,20,22,,123456\n",
        "".join(f"MPC,9,{n},{k},1.,20,{k},-1.\n" for n in (1, 4, 5, 8) for k in (1, 2, 3))
        + "SPC1,1,123,20\n",
    ],
)
def test_support_through_rigid_elements_holds_the_solid(tmp_path: Path, bulk: str) -> None:
    found, groups = nastran(tmp_path, "", CENTRE + bulk)
    assert held(found, groups) == {(0, 3, 4, 7): (0, 1, 2)} and not found.not_taken


@pytest.mark.parametrize(
    ("bulk", "names"),
    [
        (f"RBE2,50,20,123456,{FACE}\nSPC1,1,123,20\n", "RBE2"),  # a hinge
        (f"RBE3,50,,20,123,1.,123,{FACE[:5]}\n,8\nSPC1,1,123456,20\n", "RBE3"),
        ("SPC1,1,123456,20\n", "beside the solid"),
    ],
)
def test_support_that_cannot_be_had_is_named(tmp_path: Path, bulk: str, names: str) -> None:
    found, _ = nastran(tmp_path, "", CENTRE + bulk)
    assert not any(components == (0, 1, 2) for _, components in found.supports)
    assert any(names in what for what in found.not_taken)


REFERENCE = "*NODE, NSET=Ref\n30, -1., .5, .5\n*NODE\n31, -1., .5, 1.\n"
SURFACE = "*ELSET, ELSET=one\n1\n*SURFACE, NAME=Wall\none, S6\n"
HOLD = "*BOUNDARY\nRef, 1, 6\n"


@pytest.mark.parametrize(
    ("coupling", "taken"),
    [
        ("*COUPLING, CONSTRAINT NAME=c, REF NODE=ref, SURFACE=wall\n*KINEMATIC\n" + HOLD, True),
        ("*KINEMATIC COUPLING, REF NODE=Ref\nfix, 1, 3\n" + HOLD, True),
        ("*MPC\nBEAM, fix, Ref\n" + HOLD, True),
        (
            "*SURFACE, TYPE=NODE, NAME=n\nfix, 1.\n*COUPLING, REF NODE=30, SURFACE=N\n*KINEMATIC\n"
            + HOLD,
            True,
        ),
        ("*RIGID BODY, REF NODE=Ref, TIE NSET=FIX\n*BOUNDARY\nref, ENCASTRE\n", True),
        ("*EQUATION\n2\nFIX, 1, 1., 30, 1, -1.\n2\nFIX, 2, 1., 30, 2, -1.\n" + HOLD, False),
        ("*COUPLING, CONSTRAINT NAME=c, REF NODE=ref, SURFACE=wall\n*DISTRIBUTING\n" + HOLD, False),
    ],
)
def test_support_through_couplings_holds_the_solid(
    tmp_path: Path, coupling: str, taken: bool
) -> None:
    head, tail = ABAQUS.replace("FIX, 1, 3\n2, 3\n", "").split("*BOUNDARY\n")
    found, groups = physics(tmp_path / "a.inp", head + REFERENCE + SURFACE + coupling + tail)
    whole = held(found, groups).get((0, 3, 4, 7)) == (0, 1, 2)
    assert whole == taken and bool(found.not_taken) == (not taken and "EQUATION" not in coupling)


def test_force_at_the_reference_of_a_mean_is_spread(tmp_path: Path) -> None:
    """The forces at the nodes have the sum and the moment of that at the reference node."""
    head, tail = ABAQUS.split("*BOUNDARY\n")
    coupling = "*COUPLING, CONSTRAINT NAME=c, REF NODE=ref, SURFACE=wall\n*DISTRIBUTING\n"
    tail = tail.replace("7, 2, -5.", "Ref, 3, 6.").replace("FIX, 1", "6, 1")
    abaqus, _ = physics(
        tmp_path / "a.inp", f"{head}{REFERENCE}{SURFACE}{coupling}*BOUNDARY\n{tail}"
    )
    force = "FORCE,1,20,,6.,0.,0.,1.\n"
    mean = f"RBE3,50,,20,123456,2.,123,1,4,+\n+,5,8\n{force}"
    rigid = f"RBE2,50,21,123456,{FACE}\nRBE2,51,20,123456,21\n{force}"
    for found in (abaqus, *(nastran(tmp_path, "", CENTRE + bulk)[0] for bulk in (mean, rigid))):
        forces = [load for load in found.loads if load.kind == "force"]
        vectors = np.array([load.vector for load in forces])
        arms = np.array([load.point for load in forces]) - [-1.0, 0.5, 0.5]
        assert len(forces) == 4 and np.allclose(vectors.sum(axis=0), [0.0, 0.0, 6.0])
        assert np.allclose(np.cross(arms, vectors).sum(axis=0), 0.0, atol=1e-12)
        assert [what[:8] for what in found.not_taken] in ([], ["2 RBE2 w", "1 force "])


def test_force_whose_moment_its_nodes_cannot_carry_is_named(tmp_path: Path) -> None:
    rigid = "RBE2,50,20,123456,1\nFORCE,1,20,,6.,0.,0.,1.\n"
    found, _ = nastran(tmp_path, "", CENTRE + rigid)
    assert not found.loads and any("beside the solid" in what for what in found.not_taken)


def test_constraint_equations_of_an_archive_pass_a_support_on(tmp_path: Path) -> None:
    equations = "".join(
        f"CE,R5.0,DEFI,       2,{k:8d},  0.00000000    \n"
        f"CE,R5.0,NODE,{node:8d},{label}  ,  1.00000000    ,{9:8d},{label}  , -1.00000000    \n"
        for k, (node, label) in enumerate(((n, f"U{x}") for n in (1, 4) for x in "XYZ"), 1)
    )
    text = re.sub(r"^D,.*\n", "", ANSYS, flags=re.M)
    extra = f"{9:9d}{0:9d}{0:9d}{-1.0:21.13E}\nN,R5.3,LOC"
    text = text.replace("N,R5.3,LOC", extra) + equations
    found, groups = physics(
        tmp_path / "a.cdb", text + "DBLOCK,1\n(i9,a6,2(pg16.9))\n        9ALL    0.0  0.0\n -1\n"
    )
    assert held(found, groups) == {(0, 3): (0, 1, 2)}
    found, groups = physics(tmp_path / "a.cdb", text)
    assert not found.supports and any(what.startswith("6 CE") for what in found.not_taken)


@pytest.mark.parametrize(("option", "is_held"), [(1, True), (0, False)])
def test_rigid_beams_of_an_archive_pass_a_support_on(
    tmp_path: Path, option: int, is_held: bool
) -> None:
    text = re.sub(r"^D,.*\n", "", ANSYS, flags=re.M).replace(
        "ET,4,14\n", f"ET,4,184\nKEYOP,4,1,{option}\n"
    )
    found, groups = physics(tmp_path / "a.cdb", text + "D,6,ALL,0.\n")
    assert ((1,) in held(found, groups)) == is_held
    assert any("MPC184" in what for what in found.not_taken) != is_held


def test_forces_on_supports_are_named(tmp_path: Path) -> None:
    found, _ = physics(
        tmp_path / "a.inp", ABAQUS.replace("7, 2, -5.", "1, 2, 3.\n2, 1, 4.\n2, 3, 1.")
    )
    assert [load.vector for load in found.loads if load.point] == [(4.0, 0.0, 0.0)]
    assert found.not_taken == ("1 force at held nodes",)


def test_section_may_stand_before_its_material_in_other_letters(tmp_path: Path) -> None:
    section = "*SOLID SECTION, ELSET=eall, MATERIAL=STEEL\n"
    text = ABAQUS.replace("*SOLID SECTION, ELSET=EALL, MATERIAL=STEEL\n", "")
    text = text.replace("*MATERIAL", f"{section}*MATERIAL").replace("\nFIX, 1", '\n"Fix", 1')
    text = text.replace("NSET=FIX", 'nset="fix"')
    found, groups = physics(tmp_path / "a.inp", text)
    (material,) = found.materials
    assert (material.name, material.density) == ("Steel", 7.85e-9)
    assert held(found, groups) == {(0, 3, 4, 7): (0, 1, 2), (1,): (2,)}


def test_supports_of_one_name_in_two_instances_stay_apart(tmp_path: Path) -> None:
    nodes = ABAQUS[: ABAQUS.index("*ELEMENT")]
    cells = "*ELEMENT, TYPE=C3D8\n1, 1,2,3,4,5,6,7,8\n*NSET, NSET=low\n1, 4\n*END PART\n"
    place = "*INSTANCE, NAME=A, PART=p\n*END INSTANCE\n*INSTANCE, NAME=B, PART=p\n5.,0.,0.\n"
    text = f"*PART, NAME=p\n{nodes}{cells}*ASSEMBLY, NAME=x\n{place}*END INSTANCE\n"
    supports = "*END ASSEMBLY\n*BOUNDARY\nA.low, 1\nB.low, 2\n"
    found, groups = physics(tmp_path / "a.inp", text + supports)
    assert held(found, groups) == {(0, 3): (0,), (8, 11): (1,)}
    notes = formats.read(tmp_path / "a.inp").notes
    assert notes and not any(note_of(note).kind.doubts for note in notes)  # the names of the sets


def test_first_step_may_replace_the_supports(tmp_path: Path) -> None:
    new = "*STEP\n*STATIC\n*BOUNDARY, OP=NEW\nFIX, XSYMM\n2, 2\n"
    found, groups = physics(tmp_path / "a.inp", ABAQUS.replace("*STEP\n*STATIC\n", new))
    assert held(found, groups) == {(0, 3, 4, 7): (0,), (1,): (1,)}


def test_components_along_other_axes_are_not_taken_for_x_y_z(tmp_path: Path) -> None:
    turned = "CORD2R,5,,0.,0.,0.,0.,0.,1.,+\n+,1.,1.,0.\nGRID,9,,2.,0.,0.,5\n"
    bulk = turned + "CTETRA,2,3,9,2,3,6\nSPC1,1,1,9,1\nFORCE,2,9,5,2.,1.,0.,0.\n"
    found, groups = nastran(tmp_path, "", bulk)
    assert held(found, groups) == {(0,): (0,)}
    (left,) = found.not_taken
    assert "axes" in left and "normal" in left
    (force,) = found.loads
    assert np.allclose(force.vector, np.sqrt([2.0, 2.0, 0.0]))
    found, groups = nastran(tmp_path, "", turned + "CTETRA,2,3,9,2,3,6\nSPC1,1,123,9,1\n")
    assert held(found, groups) == {(0, 8): (0, 1, 2)} and not found.not_taken
    text = ABAQUS.replace("*BOUNDARY", "*TRANSFORM, NSET=FIX\n1.,1.,0.,-1.,1.,0.\n*BOUNDARY", 1)
    found, groups = physics(tmp_path / "a.inp", text.replace("FIX, 1, 3", "FIX, 1"))
    assert held(found, groups) == {(1,): (2,)} and any("axes" in w for w in found.not_taken)


@pytest.mark.parametrize(
    ("kind", "given", "expected"),
    [
        ("C", "0.,1.,0.", (-1.0, 0.0, 0.0)),
        ("S", "1.,0.,0.", (0.0, 0.6, 0.8)),
        ("S", "0.,0.,1.", (-1.0, 0.0, 0.0)),
    ],
)
def test_forces_along_curved_coordinates_turn_with_their_node(
    tmp_path: Path, kind: str, given: str, expected: tuple[float, ...]
) -> None:
    system = f"CORD2{kind},5,,0.,0.,0.,0.,0.,1.,+\n+,1.,0.,0.\nGRID,9,,0.,3.,4.\n"
    bulk = f"{system}CTETRA,2,3,2,3,6,9\nFORCE,2,9,5,2.,{given}\nGRAV,2,5,1.,{given}\n"
    found, _ = nastran(tmp_path, "", bulk)
    (load,) = found.loads
    assert np.allclose(load.vector, 2.0 * np.array(expected))
    assert found.not_taken == ("1 GRAV along axes that depend on the place",)


def test_pressures_on_faces_of_elements_are_loads_on_groups(tmp_path: Path) -> None:
    """The same face by its number in Abaqus, and by its opposite corners in Nastran."""
    text = ABAQUS.replace("*CLOAD\n", "*DLOAD\nEALL, P2, 3.5\n*CLOAD\n")
    (tmp_path / "a.inp").write_text(text)
    (tmp_path / "a.bdf").write_text(
        NASTRAN.replace("GRAV", "PLOAD4,9,1,7.,,,,5,7\nLOAD,8,1.,.5,9\nGRAV").replace("= 9", "= 8")
    )
    for name in ("a.inp", "a.bdf"):
        mesh = formats.read(tmp_path / name)
        assert DeckLoad("pressure", (3.5,), group="pressure 3.5") in mesh.physics.loads
        (facets,) = (block for block in mesh.blocks if "pressure 3.5" in block.groups)
        assert np.sort(facets.nodes).tolist() == [[4, 5, 6, 7]], "the face z = 1"


def test_each_pressure_has_its_own_group(tmp_path: Path) -> None:
    """Pressures that agree in six digits are two loads; a field of pressures is named."""
    found = bar(tmp_path / "a.inp", "*DLOAD\n1, P1, 101325.1\n2, P1, 101325.2\n", number=2)
    groups = {"pressure 101325.1", "pressure 101325.2"}
    assert {load.group for load in found.loads} == groups and not found.not_taken
    assert {g for b in formats.read(tmp_path / "a.inp").blocks for g in b.groups} == {"E"} | groups
    field = "".join(f"{k % 16 + 1}, P{k // 16 + 1}, {k}.5\n" for k in range(21))
    found = bar(tmp_path / "a.inp", f"*DLOAD\n{field}")
    assert not found.loads and ["21 sizes" in what for what in found.not_taken] == [True]


@pytest.mark.parametrize("own", ["1, 4, 5, 8", "2, 3, 6, 7", "2, 3, 6, 7, 8"])
def test_support_of_a_node_set_with_the_name_of_a_surface_elsewhere(
    own: str, tmp_path: Path
) -> None:
    """The surface is the face x = 1; a place of a scene takes its facets, not the node set."""
    text = ABAQUS.replace("NSET=FIX\n1, 4, 5, 8", f"NSET=FIX\n{own}").replace("\n2, 3\n", "\n")
    found, groups = physics(tmp_path / "a.inp", f"*SURFACE, NAME=FIX\n1, S4\n{text}")
    name = "FIX" if own == "2, 3, 6, 7" else "FIX (nodes)"
    assert found.supports == ((name, (0, 1, 2)),)
    assert groups == {name: [int(n) - 1 for n in own.split(", ")]}


TETRA, WEDGE = "CTETRA,1,3,1,2,4,5", "CPENTA,1,3,1,2,4,5,6,8"


@pytest.mark.parametrize(
    ("card", "nodes", "face"),
    [(TETRA, "2,1", [1, 3, 4]), (WEDGE, "1", [0, 1, 3]), (WEDGE, "2,8", [1, 3, 5, 7])],
)
def test_pressure_on_faces_of_tetrahedra_and_wedges(
    tmp_path: Path, card: str, nodes: str, face: list[int]
) -> None:
    grids = NASTRAN[NASTRAN.index("GRID") : NASTRAN.index("CHEXA")]
    text = f"BEGIN BULK\n{grids}{card}\nPLOAD4,9,1,7.,,,,{nodes}\nENDDATA\n"
    (tmp_path / "a.bdf").write_text(text)
    mesh = formats.read(tmp_path / "a.bdf")
    loaded = [block.nodes for block in mesh.blocks if "pressure 7" in block.groups]
    assert np.unique(np.concatenate(loaded)).tolist() == face


def test_materials_that_the_file_lacks_or_that_are_not_isotropic(tmp_path: Path) -> None:
    """Without any material, the scene has one of its own; else the missing one is named."""
    text = re.sub(r"^MP.*\n", "", ANSYS, flags=re.M)
    found, _ = physics(tmp_path / "a.cdb", text)
    assert found.materials == () and not any("material" in what for what in found.not_taken)
    for name in ("MAT9", "MAT12"):
        text = NASTRAN.replace("MAT1,1,2.1+5", f"{name},1,2.1+5")
        found, _ = physics(tmp_path / "b.bdf", text)
        assert found.materials == (DeckMaterial(f"{name} 1", None, None, None),)
        assert any(f"{name} 1" in what for what in found.not_taken)
    other = "CTETRA,2,4,2,3,6,9\nGRID,9,,5.,0.,0.\nPSOLID,4,2\n"
    found, _ = physics(tmp_path / "b.bdf", NASTRAN.replace("CONM2", f"{other}CONM2"))
    assert [material.young for material in found.materials] == [2.1e5, None]
    assert found.materials[1].group == "4" and any("not in the file" in w for w in found.not_taken)


def bar(path: Path, loads: str, more: str = "", number: int = 4, stretch: float = 1.0) -> Physics:
    """A block of cubes, whose nodes on the face z = 0 are numbered 1 to (number + 1)²."""
    x = [k * stretch if k == number else float(k) for k in range(number + 1)]
    places = [(x[i], j, k) for k in (0, 1) for j in range(number + 1) for i in range(number + 1)]
    row, layer = number + 1, (number + 1) ** 2
    text = "*NODE\n" + "".join(f"{n}, {a}, {b}, {c}\n" for n, (a, b, c) in enumerate(places, 1))
    text += "*ELEMENT, TYPE=C3D8, ELSET=E\n"
    for j in range(number):
        for i in range(number):
            a = 1 + i + row * j
            base = (a, a + 1, a + row + 1, a + row)
            cell = ", ".join(map(str, (*base, *(n + layer for n in base))))
            text += f"{1 + i + number * j}, {cell}\n"
    text += f"*NSET, NSET=Low, GENERATE\n1, {layer}\n{more}*STEP\n*STATIC\n{loads}*END STEP\n"
    return physics(path, text)[0]


def test_many_forces_of_one_direction_become_their_sum_on_a_group(tmp_path: Path) -> None:
    found = bar(tmp_path / "a.inp", "*CLOAD\nlow, 3, 2.\n")
    assert found.loads == (DeckLoad("force", (0.0, 0.0, 50.0), group="Low"),)
    assert ["distribution" in what for what in found.not_taken] == [True]


def test_many_forces_at_two_places_become_two_loads(tmp_path: Path) -> None:
    high = "*NSET, NSET=High, GENERATE\n26, 50\n"
    found = bar(tmp_path / "a.inp", "*CLOAD\nlow, 3, 2.\nHigh, 3, 1.\nHigh, 1, 1.\n", high)
    assert {load.vector for load in found.loads} == {(0.0, 0.0, 50.0), (25.0, 0.0, 25.0)}


@pytest.mark.parametrize(
    ("loads", "stretch"),
    [
        ("*CLOAD\nlow, 3, 2.\n", 3.0),  # their line does not run through the centroid
        ("*CLOAD\n" + "".join(f"{n}, 3, {n}.\n" for n in range(1, 26)), 1.0),
    ],
)
def test_many_forces_that_no_group_can_replace_are_named(
    tmp_path: Path, loads: str, stretch: float
) -> None:
    found = bar(tmp_path / "a.inp", loads, stretch=stretch)
    assert not found.loads
    assert ["forces at 25 nodes" in what for what in found.not_taken] == [True]


def test_few_forces_stay_at_their_nodes(tmp_path: Path) -> None:
    loads = "*CLOAD\n" + "".join(f"{n}, 3, 2.\n" for n in range(1, 21))
    assert [load.group for load in bar(tmp_path / "a.inp", loads).loads] == [None] * 20


QUADRATIC = [
    *PLACES,
    *((0.5, 0, 0), (1, 0.5, 0), (0.5, 1, 0), (0, 0.5, 0)),
    *((0.5, 0, 1), (1, 0.5, 1), (0.5, 1, 1), (0, 0.5, 1)),
    *((0, 0, 0.5), (1, 0, 0.5), (1, 1, 0.5), (0, 1, 0.5)),
]


BRICK = (
    "*NODE\n"
    + "".join(f"{k}, {x}, {y}, {z}\n" for k, (x, y, z) in enumerate(QUADRATIC, 1))
    + f"*ELEMENT, TYPE=C3D20\n1, {', '.join(map(str, range(1, 16)))},\n16, 17, 18, 19, 20\n"
)


def test_support_beside_the_following_face_of_a_sector_takes_its_nodes(tmp_path: Path) -> None:
    """A deck of CalculiX cannot hold them: here those of the side x = 0 on y = 0."""
    text = BRICK + "*NSET, NSET=low\n1, 2, 5, 6, 9, 13, 17, 18\n*NSET, NSET=high\n3, 4, 7, 8\n"
    text += "*TIE, CYCLIC SYMMETRY, NAME=cut\nlow, high\n"
    text += "*NSET, NSET=fix\n4, 8, 12, 16, 20\n*BOUNDARY\nfix, 1, 3\n"
    found, groups = physics(tmp_path / "a.inp", text)
    assert [(groups[place], held) for place, held in found.supports] == [
        ([0, 3, 4, 7, 11, 15, 16, 19], (0, 1, 2))
    ]


@pytest.mark.parametrize("more", ["", "1, 4, "])
def test_nodes_on_edges_alone_are_held_by_their_coordinates(tmp_path: Path, more: str) -> None:
    """The edge between corners of the group holds its own node."""
    text = BRICK + f"*NSET, NSET=mid\n{more}12, 16, 17, 20\n*BOUNDARY\nmid, 1, 2\n"
    found, groups = physics(tmp_path / "a.inp", text)
    alone = {place for place, _ in found.supports if not isinstance(place, str)}
    middles = {(0.0, 0.5, 1.0), (0.0, 0.0, 0.5), (0.0, 1.0, 0.5)}
    assert alone == (middles if more else middles | {(0.0, 0.5, 0.0)})
    by_name = [groups[place] for place, _ in found.supports if isinstance(place, str)]
    assert by_name == ([[0, 3, 11]] if more else [])


def test_plane_deck_brings_its_thickness_and_its_state_of_strain(tmp_path: Path) -> None:
    text = "*NODE\n1,0.,0.\n2,1.,0.\n3,1.,1.\n4,0.,1.\n*ELEMENT, TYPE=CPE4, ELSET=E\n1,1,2,3,4\n"
    text += "*SOLID SECTION, ELSET=E, MATERIAL=m\n0.25,\n*MATERIAL, NAME=M\n*ELASTIC\n1., 0.3\n"
    text += "*BOUNDARY\n1, 1, 3\n2, 3\n"
    shell = text.replace("CPE4", "S4").replace("SOLID SECTION", "SHELL SECTION")
    found, _ = physics(tmp_path / "a.inp", shell)
    assert found.thickness == 0.25 and found.materials[0].young == 1.0
    found, groups = physics(tmp_path / "a.inp", text)
    assert found.thickness == 0.25 and found.strain
    assert held(found, groups) == {(0,): (0, 1)}, "z means nothing in the plane"
    text += "*STEP\n*STATIC\n*DLOAD\n1, P2, 4.\n1, GRAV, 9., 0., -1., 0.\n*END STEP\n"
    (tmp_path / "a.inp").write_text(text)
    mesh = formats.read(tmp_path / "a.inp")
    (edge,) = (block.nodes.tolist() for block in mesh.blocks if "pressure 4" in block.groups)
    assert edge == [[1, 2]] and not mesh.physics.not_taken


def test_gravity_of_a_part_of_the_body_is_named(tmp_path: Path) -> None:
    found = bar(tmp_path / "a.inp", "*DLOAD\n1, GRAV, 9., 0., 0., -1.\n", number=2)
    assert any("gravity" in what for what in found.not_taken)
    for whole in ("E, GRAV, 9.", "1, GRAV, 9., 0., 0., -1.\n2, GRAV, 9., 0., 0., -1.\nF, GRAV, 9."):
        sets = "*ELSET, ELSET=F\n3, 4\n"
        found = bar(tmp_path / "a.inp", f"*DLOAD\n{whole}, 0., 0., -1.\n", sets, number=2)
        assert not found.not_taken
        assert found.loads == (DeckLoad("acceleration", (0.0, 0.0, -9.0)),)


@pytest.mark.parametrize(
    ("step", "load", "said"),
    [
        ("", "*CLOAD, FOLLOWER\n1, 1, 2.\n", "FOLLOWER"),
        (", NLGEOM", "*DLOAD\n1, P1, 2.\n", "NLGEOM"),
        (", NLGEOM=NO", "*DLOAD\n1, P1, 2.\n", ""),
        (", NLGEOM", "*CLOAD\n1, 1, 2.\n", ""),
    ],
)
def test_loads_that_turn_with_the_body_are_named(
    step: str, load: str, said: str, tmp_path: Path
) -> None:
    found = bar(tmp_path / "a.inp", f"{load}*END STEP\n*STEP\n", number=2)
    path = tmp_path / "a.inp"
    path.write_text(path.read_text().replace("*STEP\n*STATIC", f"*STEP{step}\n*STATIC"))
    found = formats.read(path).physics
    assert [said in what for what in found.not_taken] == ([True] if said else [])
    assert len(found.loads) == 1


def test_mass_and_spring_elements_belong_to_sets_of_their_part(tmp_path: Path) -> None:
    """A set may be given behind its elements, and two parts may have sets of one name."""
    nodes = ABAQUS[: ABAQUS.index("*ELEMENT")]
    cells = "*ELEMENT, TYPE=C3D8\n1, 1,2,3,4,5,6,7,8\n*ELEMENT, TYPE=MASS, ELSET=m\n2, 7\n"
    cells += "*ELEMENT, TYPE=SPRING1\n3, 7\n4, 8\n*ELSET, ELSET=s\n3\n*SPRING, ELSET=s\n2\n90.\n"
    text = "".join(
        f"*PART, NAME={name}\n{nodes}{cells}*MASS, ELSET=m\n{mass}\n*END PART\n"
        for name, mass in (("p", 1.0), ("q", 2.0))
    )
    text += "*ASSEMBLY, NAME=x\n*INSTANCE, NAME=A, PART=p\n*END INSTANCE\n"
    text += "*INSTANCE, NAME=B, PART=q\n5.,0.,0.\n*END INSTANCE\n*END ASSEMBLY\n"
    found, _ = physics(tmp_path / "a.inp", text)
    places = (1.0, 1.0, 1.0), (6.0, 1.0, 1.0)
    assert found.masses == tuple(zip(places, (1.0, 2.0), strict=True))
    assert found.springs == tuple((place, 1, 90.0) for place in places)


ANSYS_PLANE = """/PREP7
ET,1,183
NBLOCK,6,SOLID
(3i9,6e21.13e3)
        1        0        0
        2        0        0  1.0000000000000E+00
        3        0        0  1.0000000000000E+00  1.0000000000000E+00
        4        0        0
N,R5.3,LOC,       -1,
EBLOCK,19,SOLID
(19i9)
        1        1        3        1        0        0        0        0        4        0        1\
        1        2        3        4
       -1
R,3,.25
""".replace("        4        0        0\n", f"{4:9d}{0:9d}{0:9d}{0.0:21.13E}{1.0:21.13E}\n")


@pytest.mark.parametrize(
    ("option", "expected"),
    [(0, (None, False, 0)), (1, (None, False, 1)), (2, (None, True, 0)), (3, (0.25, False, 0))],
)
def test_plane_archive_says_what_is_plane(option: int, expected: tuple, tmp_path: Path) -> None:
    inline = ANSYS_PLANE.replace("ET,1,183", f"ET,1,PLANE183,,,{option}")
    for text in (f"{ANSYS_PLANE}KEYOP,1,3,{option}\n", inline):
        (tmp_path / "a.cdb").write_text(text)
        mesh = formats.read(tmp_path / "a.cdb")
        assert (mesh.physics.thickness, mesh.physics.strain, len(mesh.not_read)) == expected


def test_orthotropic_material_of_an_archive_is_not_isotropic(tmp_path: Path) -> None:
    more = "MPDATA,R5.0, 1,{}  ,       1, 1,  {}    ,\nMPDATA,R5.0, 1,DENS"
    for name, value, young in (("EY", 1e4, None), ("EZ", 1e4, None), ("EY", 2.1e5, 2.1e5)):
        text = ANSYS.replace("MPDATA,R5.0, 1,DENS", more.format(name, value))
        found, _ = physics(tmp_path / "a.cdb", text)
        assert found.materials[0].young == young


def test_loads_in_the_middle_of_edges_of_wedges_of_an_archive_are_taken(tmp_path: Path) -> None:
    """A hexahedron of 20 nodes with two edges without a length is a wedge of 15 nodes."""
    corners = (1, 2, 3, 3, 5, 6, 7, 7)
    middles = (9, 10, 3, 11, 12, 13, 7, 14, 15, 16, 17, 17)
    ends = [(0, 1), (1, 2), (2, 0), (4, 5), (5, 6), (6, 4), (0, 4), (1, 5), (2, 6)]
    edges = np.array([np.array(PLACES)[[a, b]].mean(axis=0) for a, b in ends])
    lines = "".join(
        f"{k:9d}{0:9d}{0:9d}" + "".join(f"{float(x):21.13E}" for x in place) + "\n"
        for k, place in enumerate(edges, 9)
    )
    text = ANSYS[: ANSYS.index("EBLOCK")].replace("N,R5.3", f"{lines}N,R5.3")
    head = (1, 1, 1, 1, 0, 0, 0, 0, 20, 0, 1)
    row = "".join(f"{n:9d}" for n in (*head, *corners)) + "\n" + "".join(f"{n:9d}" for n in middles)
    text += f"EBLOCK,19,SOLID\n(19i9)\n{row}\n       -1\nF,13,FZ,-5.\n"
    text += "F,13,FZ,-5.\n"  # which replaces the first one
    found, _ = physics(tmp_path / "a.cdb", text.replace("ET,1,185", "ET,1,186"))
    assert found.loads == (DeckLoad("force", (0.0, 0.0, -5.0), tuple(edges[4].tolist())),)
