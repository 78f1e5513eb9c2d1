"""Materials, supports, masses, springs and loads of decks: the same cube in three formats."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from fenicsrom import formats
from fenicsrom.formats.mesh_file import DeckLoad, DeckMaterial, Physics

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
    assert found.not_taken == (("1 SPC1 of the set 2",) if name == "a.bdf" else ())


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
    found, _ = physics(tmp_path / "a.inp", text)
    assert len(found.not_taken) == 3 and not found.springs


def test_shear_modulus_gives_poissons_ratio(tmp_path: Path) -> None:
    found, _ = physics(tmp_path / "a.bdf", NASTRAN.replace("2.1+5,,.3,", "2.1+5,8.4+4,,"))
    assert found.materials[0].poisson == pytest.approx(0.25)
    text = NASTRAN.replace("CONM2", "PARAM,WTMASS,2.\nCONM2")
    found, _ = physics(tmp_path / "a.bdf", text)
    assert found.masses[0][1] == 2e-4 and found.materials[0].density == 1.57e-8
