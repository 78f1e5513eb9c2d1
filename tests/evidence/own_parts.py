"""Ten parts from file to modes, a run with friction contact and a response curve.

    docker/run python3 tests/evidence/own_parts.py --output out/own_parts
    python3 tests/evidence/own_parts.py --output out/own_parts

The first command draws five CAD bodies, writes five decks as Abaqus, CalculiX, Nastran and ANSYS
write them, and takes each through `fenicsrom init`, `modes`, `run`, `response` and `export`. Where
`ccx` is installed, the second command runs it on the exported decks, and writes a table; this part
needs Python alone.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))
from calculix import MODES, run_ccx

NUMBERS = "ours.json"

FINER = 0.7
"""The cells of the refined mesh of a CAD body, relative to those of `init`."""

QUIET = ("--force", "--set", "output.pictures=false", "--set", "output.paraview=false")

ORDER = {
    11: (0, 1, 2, 3, 4, 5, 6, 7, 9, 8),
    17: (0, 1, 2, 3, 4, 5, 6, 7, 8, 11, 13, 9, 16, 18, 19, 17, 10, 12, 14, 15),
    18: (0, 1, 2, 3, 4, 5, 6, 9, 7, 12, 14, 13, 8, 10, 11),
}
"""Places in gmsh of the nodes of tetrahedra, hexahedra and wedges of degree 2 of the decks."""


@dataclass(frozen=True)
class Part:
    """A part.

    Attributes:
        file: name of its file.
        what: what it is.
        draw: draws its body in mm, with gmsh's kernel of CAD bodies.
        write: writes its deck; None for a CAD file.
        init: options of `fenicsrom init`.
    """

    file: str
    what: str
    draw: Callable[[Any], None]
    write: Callable[[Any, Path], None] | None = None
    init: tuple[str, ...] = ()


def curves(gmsh: Any, *box: float) -> list[int]:
    """The curves of the body inside a box, from x, y, z to x, y, z in mm."""
    gmsh.model.occ.synchronize()
    return [tag for _, tag in gmsh.model.getEntitiesInBoundingBox(*box, 1)]


def draw_rod(gmsh: Any) -> None:
    """A connecting rod: two eyes with bores, a shank with a hole, fillets of 6 mm."""
    occ = gmsh.model.occ
    eyes = [
        (3, occ.addCylinder(0, 0, 0, 0, 0, 14, 22)),
        (3, occ.addCylinder(110, 0, 0, 0, 0, 14, 13)),
    ]
    rod, _ = occ.fuse(eyes, [(3, occ.addBox(0, -8, 3, 110, 16, 8))])
    bores = [(3, occ.addCylinder(x, 0, -1, 0, 0, 16, r)) for x, r in ((0, 14), (110, 7), (60, 4))]
    rod, _ = occ.cut(rod, bores)
    edges = [c for y in (-8, 8) for c in curves(gmsh, 10, y - 0.1, 2.9, 105, y + 0.1, 11.1)]
    upright = [
        c
        for c in edges
        if gmsh.model.getBoundingBox(1, c)[5] - gmsh.model.getBoundingBox(1, c)[2] > 7
    ]
    occ.fillet([rod[0][1]], upright, [6.0])


def draw_blade(gmsh: Any) -> None:
    """A fan blade: a twisted aerofoil on a platform with a dovetail, fillets of 3 mm."""
    occ, loops = gmsh.model.occ, []
    for z in (-2, 35, 75, 110, 140):
        chord, thick, twist = 70 - 0.08 * z, 0.11 - 0.0003 * z, math.radians(15 + 0.22 * z)
        stations = [0.5 * (1 - math.cos(math.pi * k / 8)) for k in range(9)]
        sides: list[list[int]] = [[], []]
        for sign, side in zip((1, -1), sides, strict=True):
            for x in stations[0 if sign > 0 else 1 :]:
                half = (
                    5
                    * thick
                    * (
                        0.2969 * math.sqrt(x)
                        + x * (-0.126 + x * (-0.3516 + x * (0.2843 - 0.095 * x)))
                    )
                )
                a, b = (x - 0.45) * chord, (0.2 * x * (1 - x) + sign * half) * chord
                point = (
                    a * math.cos(twist) - b * math.sin(twist),
                    a * math.sin(twist) + b * math.cos(twist),
                    z,
                )
                side.append(occ.addPoint(*point))
        upper, lower = occ.addSpline(sides[0]), occ.addSpline([sides[0][0], *sides[1]])
        loops.append(occ.addCurveLoop([upper, occ.addLine(sides[0][-1], sides[1][-1]), -lower]))
    aerofoil = occ.addThruSections(loops, makeSolid=True, makeRuled=False)
    platform = [(3, occ.addBox(-45, -28, -9, 90, 56, 9))]
    outline = [
        (-11, -9),
        (11, -9),
        (11, -13),
        (18, -24),
        (15, -29),
        (-15, -29),
        (-18, -24),
        (-11, -13),
    ]
    points = [occ.addPoint(-45, y, z) for y, z in outline]
    lines = [occ.addLine(points[k - 1], points[k]) for k in range(8)]
    foot = occ.extrude([(2, occ.addPlaneSurface([occ.addCurveLoop(lines)]))], 90, 0, 0)
    blade, _ = occ.fuse(
        [v for v in aerofoil if v[0] == 3], platform + [v for v in foot if v[0] == 3]
    )
    edges = curves(gmsh, -44, -27, -0.1, 44, 27, 0.1)
    for y in (-11, 11):
        edges += curves(gmsh, -45.1, y - 0.1, -9.1, 45.1, y + 0.1, -8.9)
    occ.fillet([blade[0][1]], edges, [3.0])


def draw_channel(gmsh: Any) -> None:
    """A sheet of 1.5 mm bent to a channel, with a round in each bend, and six holes."""
    occ = gmsh.model.occ
    bodies = []
    for low, (x, y, z), radius in ((0, (140, 40, 25), 4.0), (1.5, (142, 38.5, 30), 2.5)):
        box = occ.addBox(0 if low == 0 else -1, low, low, x, y - low, z)
        edges = []
        for side in (low, y):
            edges += curves(gmsh, -2, side - 0.1, low - 0.1, 142, side + 0.1, low + 0.1)
        bodies.append(occ.fillet([box], edges, [radius]))
        occ.synchronize()
    sheet, _ = occ.cut(*bodies)
    holes = [occ.addCylinder(x, y, -1, 0, 0, 4, 3) for x in (15, 70, 125) for y in (14, 26)]
    occ.cut(sheet, [(3, tag) for tag in holes])


def draw_tool(gmsh: Any) -> None:
    """Three bodies that touch: a holder, a shank through it, and a tip."""
    occ = gmsh.model.occ
    box, bore = occ.addBox(0, 0, 0, 50, 40, 30), occ.addCylinder(-1, 20, 15, 140, 0, 0, 8)
    occ.cut([(3, box)], [(3, bore)])
    occ.addCylinder(0, 20, 15, 120, 0, 0, 8)
    occ.addBox(120, 12, 10, 8, 16, 10)


def draw_cover(gmsh: Any) -> None:
    """A cast cover: a pot with walls of 3 mm, a flange with four holes, and a round at its top."""
    occ = gmsh.model.occ
    pot = occ.addCylinder(0, 0, 0, 0, 0, 40, 35)
    occ.fillet([pot], curves(gmsh, -36, -36, 39.9, 36, 36, 40.1), [8.0])
    cover, _ = occ.fuse([(3, pot)], [(3, occ.addCylinder(0, 0, 0, 0, 0, 5, 50))])
    hollow = occ.addCylinder(0, 0, -1, 0, 0, 38, 32)
    occ.fillet([hollow], curves(gmsh, -33, -33, 36.9, 33, 33, 37.1), [5.0])
    holes = [
        occ.addCylinder(42 * x, 42 * y, -1, 0, 0, 7, 3.5)
        for x, y in ((1, 0), (0, 1), (-1, 0), (0, -1))
    ]
    cover, _ = occ.cut(cover, [(3, hollow), *((3, tag) for tag in holes)])
    occ.cut(cover, [(3, occ.addCylinder(0, 0, 30, 0, 0, 20, 6))])


def draw_lever(gmsh: Any) -> None:
    """A bent lever with a bore."""
    occ = gmsh.model.occ
    arms = [(3, occ.addBox(0, 0, 0, 90, 18, 10))], [(3, occ.addBox(72, 0, 0, 18, 70, 10))]
    occ.cut(occ.fuse(*arms)[0], [(3, occ.addCylinder(81, 58, -1, 0, 0, 12, 5))])


def draw_leaf(gmsh: Any) -> None:
    """A leaf spring of hexahedra."""
    swept(gmsh, [(0, 0), (120, 0), (120, 12), (0, 12)], (24, 3), 3.0, 1)


def draw_boss(gmsh: Any) -> None:
    """A plate with a boss of another material."""
    occ = gmsh.model.occ
    plate, boss = occ.addBox(0, 0, 0, 130, 45, 5), occ.addCylinder(100, 22, 5, 0, 0, 14, 9)
    occ.fragment([(3, plate)], [(3, boss)])


def draw_fork(gmsh: Any) -> None:
    """A plate of hexahedra that ends in wedges."""
    swept(gmsh, [(0, 0), (70, 0), (70, 24), (0, 24)], (14, 5), 6.0, 2, (105, 12))


def draw_bar(gmsh: Any) -> None:
    """A bar of hexahedra that ends in wedges, in m."""
    swept(gmsh, [(0, 0), (0.2, 0), (0.2, 0.03), (0, 0.03)], (14, 3), 0.012, 1, (0.25, 0.015))


def swept(
    gmsh: Any,
    corners: list[tuple[float, float]],
    counts: tuple[int, int],
    height: float,
    layers: int,
    apex: tuple[float, float] | None = None,
) -> None:
    """A layer of hexahedra on a rectangle, and of wedges on a triangle beyond its second side."""
    occ = gmsh.model.occ
    points = [occ.addPoint(*corner, 0) for corner in corners]
    lines = [occ.addLine(points[k], points[(k + 1) % 4]) for k in range(4)]
    faces = [occ.addPlaneSurface([occ.addCurveLoop(lines)])]
    if apex is not None:
        end = occ.addPoint(*apex, 0)
        beyond = [occ.addLine(points[1], end), occ.addLine(end, points[2]), -lines[1]]
        faces.append(occ.addPlaneSurface([occ.addCurveLoop(beyond)]))
    occ.synchronize()
    for k, line in enumerate(lines):
        gmsh.model.mesh.setTransfiniteCurve(line, counts[k % 2] + 1)
    gmsh.model.mesh.setTransfiniteSurface(faces[0])
    gmsh.model.mesh.setRecombine(2, faces[0])
    occ.extrude([(2, face) for face in faces], 0, 0, height, [layers], recombine=True)


Mesh = tuple[list[list[float]], dict[int, list[list[int]]], dict[int, list[int]]]
"""Points; nodes of the cells of each kind of gmsh, from 1; cells of each body, from 1."""


def meshed(gmsh: Any, size: float) -> Mesh:
    """Mesh the body with cells of degree 2, whose numbers run through the kinds."""
    gmsh.model.occ.synchronize()
    gmsh.option.setNumber("Mesh.MeshSizeMax", size)
    gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", 10)
    gmsh.option.setNumber("Mesh.SecondOrderIncomplete", 1)
    gmsh.model.mesh.generate(3)
    gmsh.model.mesh.setOrder(2)
    gmsh.model.mesh.renumberNodes()
    numbers, x, _ = gmsh.model.mesh.getNodes()
    points = [[0.0, 0.0, 0.0] for _ in numbers]
    for k, number in enumerate(numbers):
        points[int(number) - 1] = [float(value) + 0.0 for value in x[3 * k : 3 * k + 3]]
    cells: dict[int, list[list[int]]] = {}
    bodies: dict[int, list[int]] = {}
    count = 0
    for kind in sorted(gmsh.model.mesh.getElementTypes(3)):
        for _, body in gmsh.model.getEntities(3):
            nodes = gmsh.model.mesh.getElementsByType(kind, body)[1].reshape(-1, len(ORDER[kind]))
            rows = nodes[:, ORDER[kind]].tolist()
            cells.setdefault(kind, []).extend(rows)
            bodies.setdefault(body, []).extend(range(count + 1, count + len(rows) + 1))
            count += len(rows)
    return points, cells, bodies


def at(points: list[list[float]], axis: int, value: float) -> list[int]:
    """The numbers of the points on a plane."""
    return [k for k, point in enumerate(points, 1) if abs(point[axis] - value) < 1e-6]


def lines_of(numbers: list[int], width: int = 8) -> str:
    """Numbers in lines, with commas."""
    rows = [numbers[k : k + width] for k in range(0, len(numbers), width)]
    return "".join(", ".join(map(str, row)) + "\n" for row in rows)


def write_abaqus(gmsh: Any, path: Path) -> None:
    """A deck as Abaqus/CAE writes it: part, instance, sets of the assembly; mm, t, s."""
    points, cells, _ = meshed(gmsh, 6.0)
    tets = cells[11]
    text = "*Heading\n** Job name: lever Model name: Model-1\n*Preprint, echo=NO, model=NO\n"
    text += "** PARTS\n*Part, name=Lever\n*Node\n"
    text += "".join(
        f"{k:7d}, {x:12.6g}, {y:12.6g}, {z:12.6g}\n" for k, (x, y, z) in enumerate(points, 1)
    )
    text += "*Element, type=C3D10\n"
    text += "".join(f"{k}, {', '.join(map(str, row))}\n" for k, row in enumerate(tets, 1))
    text += f"*Elset, elset=Set-1, generate\n    1, {len(tets)},     1\n** Section: Section-1\n"
    text += "*Solid Section, elset=Set-1, material=Steel\n,\n*End Part\n**\n** ASSEMBLY\n"
    text += "*Assembly, name=Assembly\n*Instance, name=Lever-1, part=Lever\n 10., 0., 5.\n"
    text += "*End Instance\n"
    for name, nodes in (("Wall", at(points, 0, 0.0)), ("End", at(points, 1, 70.0))):
        text += f"*Nset, nset={name}, instance=Lever-1\n{lines_of(nodes, 16)}"
    text += "*End Assembly\n** MATERIALS\n*Material, name=Steel\n*Density\n 7.85e-09,\n*Elastic\n"
    text += "210000., 0.3\n** BOUNDARY CONDITIONS\n*Boundary\nWall, ENCASTRE\n** STEP: Step-1\n"
    text += "*Step, name=Step-1, nlgeom=YES\n*Static\n1., 1., 1e-05, 1.\n** LOADS\n*Dload\n"
    text += ", GRAV, 9810., 0., 0., -1.\n*Restart\n"
    text += "*Output, field, variable=PRESELECT\n*End Step\n"
    path.write_text(text)


def write_calculix(gmsh: Any, path: Path) -> None:
    """A deck as for CalculiX: hexahedra of 20 nodes, a point mass, a spring; mm, t, s."""
    points, cells, _ = meshed(gmsh, 100.0)
    text = "** leaf spring\n*NODE, NSET=Nall\n"
    text += "".join(f"{k},{x:.6e},{y:.6e},{z:.6e}\n" for k, (x, y, z) in enumerate(points, 1))
    text += "*ELEMENT, TYPE=C3D20R, ELSET=Eall\n"
    for k, row in enumerate(cells[17], 1):
        text += f"{k},{','.join(map(str, row[:15]))},\n{','.join(map(str, row[15:]))}\n"
    end = min(at(points, 0, 120.0))
    for name, x in (("Nfix", 0.0), ("Nend", 120.0)):
        text += f"*NSET,NSET={name}\n{lines_of(at(points, 0, x))}"
    text += f"*ELEMENT,TYPE=MASS,ELSET=Em\n9001,{end}\n*MASS,ELSET=Em\n2e-6\n"
    text += f"*ELEMENT,TYPE=SPRING1,ELSET=Es\n9002,{end}\n*SPRING,ELSET=Es\n3\n0.5\n"
    text += "*MATERIAL,NAME=SPRINGSTEEL\n*ELASTIC\n206000.,0.3\n*DENSITY\n7.8e-9\n"
    text += "*SOLID SECTION,ELSET=Eall,MATERIAL=SPRINGSTEEL\n*BOUNDARY\nNfix,1,3\n"
    text += "*STEP\n*FREQUENCY\n6\n*NODE FILE\nU\n*END STEP\n"
    path.write_text(text)


def nastran_rows(name: str, fields: list[Any]) -> str:
    """An entry of Nastran in small fields, with lines that continue it."""
    rows = [fields[k : k + 8] for k in range(0, len(fields), 8)]
    heads = [name, *["+"] * (len(rows) - 1)]
    return "".join(
        f"{head:8s}" + "".join(f"{v!s:8s}" for v in row) + "\n"
        for head, row in zip(heads, rows, strict=True)
    )


def write_nastran(gmsh: Any, path: Path) -> None:
    """A deck of Nastran: tetrahedra, hexahedra and wedges of degree 2 in small fields; mm, t, s."""
    points, cells, bodies = meshed(gmsh, 8.0)
    text = "SOL 103\nCEND\nTITLE = part\nMETHOD = 1\nSPC = 2\nBEGIN BULK\n"
    text += "PARAM,COUPMASS,1\nEIGRL,1,,,6\n"
    for k, (x, y, z) in enumerate(points, 1):
        text += f"GRID*   {k:16d}{'':16s}{x:16.9f}{y:16.9f}\n*       {z:16.9f}\n"
    owner = {cell: body for body, members in bodies.items() for cell in members}
    names = {11: ("CTETRA", 10, 10), 17: ("CHEXA", 12, 16), 18: ("CPENTA", 9, 12)}
    number = 0
    for kind, rows in cells.items():
        name, first, last = names[kind]  # Nastran has the upper edges after the upright ones
        for row in rows:
            number += 1
            material = owner[number] if kind == 11 else 1
            row = row[:first] + row[last:] + row[first:last]
            text += nastran_rows(name, [number, material, *row])
    text += "PSOLID  1       1\nPSOLID  2       2\n"
    text += "MAT1    1       2.1+5           .3      7.85-9\n"
    text += "MAT1    2       7.+4            .33     2.7-9\n"
    for node in at(points, 0, 0.0):
        text += f"SPC1    2       123     {node:<8d}\n"
    path.write_text(text + "ENDDATA\n")


def write_ansys(gmsh: Any, path: Path) -> None:
    """An archive as Mechanical APDL writes it with CDWRITE: SOLID186, some as wedges; SI."""
    points, cells, _ = meshed(gmsh, 1.0)
    wedge = (0, 1, 2, 2, 3, 4, 5, 5, 6, 7, 2, 8, 9, 10, 5, 11, 12, 13, 14, 14)
    rows = cells[17] + [[row[k] for k in wedge] for row in cells[18]]
    held, end = at(points, 0, 0.0), at(points, 0, 0.25)
    text = "/COM,ANSYS RELEASE 2022 R1\n/PREP7\n/NOPR\nET,        1,186\n"
    text += f"NBLOCK,6,SOLID,{len(points):10d},{len(points):10d}\n(3i9,6e21.13e3)\n"
    for k, (x, y, z) in enumerate(points, 1):
        text += f"{k:9d}{0:9d}{0:9d}{x:21.13E}{y:21.13E}{z:21.13E}\n"
    text += f"N,R5.3,LOC,       -1,\nEBLOCK,19,SOLID,{len(rows):10d},{len(rows):10d}\n(19i9)\n"
    for k, row in enumerate(rows, 1):
        head = [1, 1, 1, 1, 0, 0, 0, 0, 20, 0, k, *row[:8]]
        text += "".join(f"{n:9d}" for n in head) + "\n"
        text += "".join(f"{n:9d}" for n in row[8:]) + "\n"
    text += "       -1\n"
    for name, nodes in (("HELD", held), ("END", end)):
        text += f"CMBLOCK,{name:8s},NODE,{len(nodes):8d}\n(8i10)\n"
        lines = [nodes[k : k + 8] for k in range(0, len(nodes), 8)]
        text += "".join("".join(f"{n:10d}" for n in line) + "\n" for line in lines)
    for name, value in (("EX", 7.1e10), ("PRXY", 0.33), ("DENS", 2770.0)):
        text += "MPTEMP,R5.0, 1, 1,  0.00000000    ,\n"
        text += f"MPDATA,R5.0, 1,{name:4s},       1, 1, {value:.9E},\n"
    for node in held:
        for axis in ("UX", "UY", "UZ"):
            text += f"D,{node:8d},{axis:4s},  0.000000000    ,  0.000000000\n"
    path.write_text(text + "/GO\nFINISH\n")


PARTS = (
    Part(
        "rod.step",
        "connecting rod, fillets of 6 mm",
        draw_rod,
        init=("--root", "14", "--tip", "17"),
    ),
    Part(
        "blade.step",
        "fan blade, dovetail, fillets of 3 mm",
        draw_blade,
        init=("--root=22", "--tip=4"),
    ),
    Part("channel.step", "bent sheet of 1.5 mm with holes", draw_channel),
    Part("tool.step", "three bodies that touch", draw_tool, init=("--root=1", "--tip=12")),
    Part("cover.step", "cast cover, walls of 3 mm", draw_cover, init=("--root=1",)),
    Part("lever.inp", "Abaqus/CAE: part and instance, C3D10, mm", draw_lever, write_abaqus),
    Part("leaf.inp", "CalculiX: C3D20R, mass, spring, mm", draw_leaf, write_calculix),
    Part("boss.bdf", "Nastran: CTETRA of 10 nodes, two materials, mm", draw_boss, write_nastran),
    Part("fork.bdf", "Nastran: CHEXA of 20 and CPENTA of 15 nodes, mm", draw_fork, write_nastran),
    Part("bar.cdb", "ANSYS: SOLID186, also as wedges, m", draw_bar, write_ansys),
)


def make(folder: Path) -> None:
    """Draw the bodies, and write the files of the parts."""
    import gmsh

    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.option.setString("Geometry.OCCTargetUnit", "MM")
    for part in PARTS:
        gmsh.clear()
        part.draw(gmsh)
        gmsh.model.occ.synchronize()
        if part.write is None:
            gmsh.write(str(folder / part.file))
        else:
            part.write(gmsh, folder / part.file)
    gmsh.finalize()


def given(arguments: list[str]) -> tuple[float, int, str]:
    """CPU time in s, exit code and text of a command of the program."""
    before = os.times()
    done = subprocess.run(["fenicsrom", *arguments], capture_output=True, text=True)
    after = os.times()
    used = sum(after[2:4]) - sum(before[2:4])
    return used, done.returncode, done.stdout + done.stderr


def take(part: Part, folder: Path, finer: bool) -> dict[str, Any]:
    """Take a part from its file to its curves, and a CAD body to the modes of finer cells."""
    scene, stem = str((folder / part.file).with_suffix(".toml")), Path(part.file).stem
    Path(scene).unlink(missing_ok=True)
    os.environ["FENICSROM_CACHE"] = str(folder / "cache")
    shutil.rmtree(folder / "cache", ignore_errors=True)
    options = ("--template", "stop", *part.init, "--output", scene)
    found: dict[str, Any] = {"what": part.what, "failed": [], "told": [], "seconds": {}}
    for name in ("init", "modes", "run", "response", "export"):
        rest: tuple[str, ...] = ("--output", str(folder / f"{stem}_{name}"), *QUIET)
        if name == "init":
            rest = options
        elif name == "export":
            rest = ("--format", "inp", "--output", str(folder / f"{stem}_ccx.inp"))
        command = [name, str(folder / part.file) if name == "init" else scene, *rest]
        seconds, code, text = given(command)
        found["told"] += re.findall(r"^(?:warning|fenicsrom): .*", text, re.M)
        if code:
            found["failed"].append(name)
        found["seconds"][name] = seconds
        if name == "modes":
            found["frequencies"] = [float(f) for f in re.findall(r"^\d+V +(\S+) Hz", text, re.M)]
            summary = folder / f"{stem}_modes" / "summary.json"
            found["unknowns"] = json.loads(summary.read_text())["dofs"] if not code else 0
        print(f"{part.file} {name}: {seconds:.1f} s, exit code {code}", file=sys.stderr, flush=True)
    if finer and part.write is None:
        size = re.search(r"^size = (\S+)", Path(scene).read_text(), re.M)
        assert size is not None
        smaller = f"geometry.size={FINER * float(size[1]):.4g}"
        seconds, _, text = given(
            ["modes", scene, "--output", str(folder / "finer"), *QUIET, "--set", smaller]
        )
        found["finer"] = [float(f) for f in re.findall(r"^\d+V +(\S+) Hz", text, re.M)]
    return found


def without_transient(deck: Path) -> None:
    """Leave out the step of the transient, which takes long and has no frequencies."""
    text = deck.read_text()
    if "*DYNAMIC" in text:
        deck.write_text(text[: text.rindex("*STEP", 0, text.index("*DYNAMIC"))])


def table(program: str, folder: Path) -> list[str]:
    """Run CalculiX on every deck, and give the lines of a table."""
    lines = [
        "| part | unknowns | failed | init, modes, run, response: CPU s "
        "| first and sixth frequency, Hz | against CalculiX | against finer cells |",
        "|---|---|---|---|---|---|---|",
    ]
    sentences = []
    for file, case in json.loads((folder / NUMBERS).read_text()).items():
        ours = case["frequencies"]
        deck = folder / f"{Path(file).stem}_ccx.inp"
        without_transient(deck)
        theirs = run_ccx(program, deck)["frequencies"]
        row = [f"`{file}`: {case['what']}", str(case["unknowns"])]
        row += [", ".join(case["failed"]) or "–"]
        row += [
            ", ".join(
                f"{case['seconds'][name]:.0f}" for name in case["seconds"] if name != "export"
            )
        ]
        row += [f"{ours[0]:.5g}, {ours[-1]:.5g}"]
        for others in (theirs, case.get("finer")):
            row.append(f"{largest(ours, others):.1e}" if others else "")
        lines.append(f"| {' | '.join(row)} |")
        sentences += [f"- `{file}`: {sentence}" for sentence in dict.fromkeys(case["told"])]
    return [*lines, "", *sentences]


def largest(ours: list[float], others: list[float]) -> float:
    """The largest relative difference of the frequencies."""
    return max(abs(a / b - 1.0) for a, b in zip(ours[:MODES], others[:MODES], strict=True))


def main() -> int:
    """Compute, run CalculiX, and write the table."""
    parser = argparse.ArgumentParser(description="Take ten parts from file to response curve.")
    parser.add_argument("--output", default="out/own_parts", type=Path, metavar="DIR")
    parser.add_argument("--only", nargs="*", metavar="FILE", help="some of the parts")
    parser.add_argument("--finer", action="store_true", help="modes of CAD bodies on finer cells")
    options = parser.parse_args()
    folder: Path = options.output
    folder.mkdir(parents=True, exist_ok=True)
    program = shutil.which("ccx")
    if program is None:
        make(folder)
        chosen = [part for part in PARTS if not options.only or part.file in options.only]
        numbers = folder / NUMBERS
        found = json.loads(numbers.read_text()) if numbers.is_file() else {}
        for part in chosen:
            found[part.file] = take(part, folder, options.finer)
            numbers.write_text(json.dumps(found, indent=2))
        again = f"run this script where it is, with --output {folder}"
        print(f"ccx is not installed; the decks are in {folder}: {again}", file=sys.stderr)
        return 0
    lines = table(program, folder)
    (folder / "table.md").write_text("\n".join([*lines, ""]))
    print("\n".join(lines))
    return 0


if __name__ == "__main__":
    sys.exit(main())
