"""The same bodies in this program and in CalculiX: frequencies, deflections and a large motion.

    docker/run python3 tests/evidence/calculix.py --output out/calculix
    python3 tests/evidence/calculix.py --output out/calculix

The first command computes the bodies with this program, and writes their decks as
`fenicsrom export SCENE --format inp` does. Where `ccx` is installed, the script then runs it on
each deck and writes a table; this part needs Python alone.

CalculiX integrates the stiffness and the mass of quadratic tetrahedra and triangles by rules of
degree 2, this program by rules of degree 4 or more. The table also has the numbers of this program
by rules of degree 2, which no other elements allow.
"""

from __future__ import annotations

import argparse
import json
import math
import resource
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

DEMOS = Path(__file__).parents[2] / "demos"
MODES = 6
NUMBERS = "ours.json"

STRAIGHT = ("geometry.cells='simplex'", "geometry.curved=false")
STEEL = {"young": 207e9, "poisson": 0.28, "density": 7801.0}
PLY = {
    "young": [140e9, 10e9, 9e9],
    "poisson": [0.3, 0.28, 0.4],
    "shear": [5e9, 4.5e9, 3.5e9],
    "axes": [[0.8, 0.6, 0.0], [-0.6, 0.8, 0.0]],
    "density": 1600.0,
}

PLATE = """
Point(1) = {0, 0, 0}; Point(2) = {0.4, 0, 0}; Point(3) = {0.4, 0.3, 0}; Point(4) = {0, 0.3, 0};
Line(1) = {1, 2}; Line(2) = {2, 3}; Line(3) = {3, 4}; Line(4) = {4, 1};
Curve Loop(1) = {1:4}; Plane Surface(1) = {1};
Transfinite Curve{1, 3} = 13; Transfinite Curve{2, 4} = 10; Transfinite Surface{1};
found[] = Extrude {0, 0, 0.01} { Surface{1}; Layers{1}; };
Physical Volume("solid") = {found[1]}; Physical Surface("root") = {found[5]};
Physical Surface("top") = {found[0]};
"""
"""A plate of 0.4 m x 0.3 m x 0.01 m, clamped along its edge x = 0."""

ARCH = """
Point(1) = {0, 0.99, -0.02}; Point(2) = {0, 1.01, -0.02};
Point(3) = {0, 1.01, 0.02}; Point(4) = {0, 0.99, 0.02};
Line(1) = {1, 2}; Line(2) = {2, 3}; Line(3) = {3, 4}; Line(4) = {4, 1};
Curve Loop(1) = {1:4}; Plane Surface(1) = {1}; Transfinite Curve{1:4} = 2;
Transfinite Surface{1};
left[] = Extrude {{0, 0, 1}, {0, 0, 0}, 2 * Pi / 9} { Surface{1}; Layers{24}; };
right[] = Extrude {{0, 0, 1}, {0, 0, 0}, -2 * Pi / 9} { Surface{1}; Layers{24}; };
Physical Volume("solid") = {left[1], right[1]};
Physical Surface("ends") = {left[0], right[0]}; Physical Surface("crown") = {1};
"""
"""An arch of radius 1 m over 80 degrees, 0.02 m x 0.04 m, clamped at both ends."""


def cases(folder: Path) -> Iterator[tuple[str, str, Any]]:
    """Yield name, description and scene of each body; write the meshes to a folder."""
    for name, mesh in (("plate", PLATE), ("arch", ARCH)):
        (folder / f"{name}.geo").write_text(mesh)
    yield from _blades()
    yield from _disks()
    yield from _plate_and_arch(folder)
    yield from _beams(folder)


def _blades() -> Iterator[tuple[str, str, Any]]:
    from fenicsrom import read_scene

    blade = DEMOS / "blade_campbell.toml"
    at_rest, turning = "rotation.speed_rpm=0", "rotation.speed_rpm=6000"
    yield "blade", "twisted blade at rest", read_scene(blade, [*STRAIGHT, at_rest], unloaded=True)
    spinning = read_scene(blade, [*STRAIGHT, turning], unloaded=True)
    yield "spinning", "the same at 6000 rpm", spinning
    hexahedra = read_scene(blade, ["geometry.curved=false", at_rest], unloaded=True)
    yield "hexahedra", "the same at rest, hexahedra", hexahedra
    compressor = DEMOS / "rotor37_map.toml"
    free = ["loads=[]", "contacts=[]", "basis={}", "time={}"]
    for name, what, rpm in (
        ("rotor37", "blade like that of rotor 37 at rest", 0.0),
        ("rotor37_spinning", "the same at 17188.7 rpm", 17188.7),
    ):
        turning = f"rotation={{speed_rpm={rpm}, axis=[0.0, 1.0, 0.0]}}"
        yield name, what, read_scene(compressor, [*STRAIGHT, *free, turning], unloaded=True)


def _disks() -> Iterator[tuple[str, str, Any]]:
    from fenicsrom import read_scene

    sector = [*STRAIGHT, "basis.modes=3", "cyclic.diameters=[0,1,2,3]", "rotation.coriolis=false"]
    what = "sector of a disk, three modes each of 0 to 3 nodal diameters,"
    scene = read_scene(DEMOS / "disk.toml", sector, unloaded=True)
    yield "disk_spinning", f"{what} at 6000 rpm", scene
    sector.append('loads=[{group="tip", direction=[1.0, 0.0, 0.0], force=20.0}]')
    sector += ["rotation.speed_rpm=0", "probe={nearest=[0.0, 0.4, 0.0]}"]
    scene = read_scene(DEMOS / "disk.toml", sector, unloaded=True)
    yield "disk", f"{what} at rest, pushed at the tips", scene


def _plate_and_arch(folder: Path) -> Iterator[tuple[str, str, Any]]:
    from fenicsrom import make_scene

    plate: dict[str, Any] = {
        "geometry": {"mesh": "plate.geo", "dimension": 3, "cells": "simplex"},
        "material": PLY,
        "supports": [{"group": "root"}],
        "loads": [{"nearest": [0.4, 0.0, 0.0], "direction": [0.0, 0.0, 1.0], "force": 40.0}],
        "probe": {"nearest": [0.4, 0.3, 0.0]},
    }
    yield (
        "plate",
        "orthotropic plate, axes at 37 degrees, under a corner force",
        make_scene(folder=folder, **plate),
    )
    arch: dict[str, Any] = {
        "geometry": {"mesh": "arch.geo", "dimension": 3, "cells": "simplex"},
        "material": STEEL,
        "supports": [{"group": "ends"}],
        "loads": [{"group": "crown", "direction": [0.1, -1.0, 0.0], "force": 45e3}],
        "probe": {"nearest": [0.0, 1.01, 0.02]},
    }
    yield "arch", "arch under a dead force at the crown", make_scene(folder=folder, **arch)
    plate["loads"] = [{"group": "top", "pressure": 4e4, "follower": True}]
    what = "the plate under a follower pressure"
    yield "pressed", what, make_scene(folder=folder, **plate)


def _beams(folder: Path) -> Iterator[tuple[str, str, Any]]:
    from fenicsrom import make_scene, read_scene

    beam: dict[str, Any] = {
        "geometry": {
            "mesh": "beam3d.geo",
            "dimension": 3,
            "cells": "simplex",
            "parameters": {"length": 0.5},
        },
        "material": STEEL,
        "supports": [{"group": "root"}],
        "attachments": [{"group": "tip", "mass": 1.5}, {"group": "load", "stiffness": 1e5}],
        "probe": {"group": "tip"},
    }
    yield "attached", "beam with a mass and a spring", make_scene(folder=folder, **beam)
    beam |= {
        "supports": [{"group": "root"}, {"group": "tip", "normal": [1.0, 2.0, 2.0]}],
        "attachments": [],
        "loads": [{"group": "load", "direction": [0.0, 1.0, 0.0], "force": 4e3}],
        "probe": {"nearest": [0.5, 0.0127, 0.0127]},
    }
    what = "beam on a slanted roller under a force"
    yield "roller", what, make_scene(folder=folder, **beam)
    strip = {
        "geometry": {
            "mesh": "beam2d.geo",
            "dimension": 2,
            "cells": "simplex",
            "plane": "strain",
            "thickness": 0.02,
            "parameters": {"length": 0.5, "elements_through": 2},
        },
        "material": PLY | {"axes": [[0.8, 0.6]]},
        "supports": [{"group": "root"}],
        "loads": [{"group": "tip", "direction": [0.0, 1.0], "traction": 2e5}],
        "rotation": {"speed_rpm": 3000.0, "point": [-0.1, 0.0]},
        "probe": {"nearest": [0.5, 0.0]},
    }
    what = "turning orthotropic strip in plane strain under a traction"
    yield "strip", what, make_scene(folder=folder, **strip)
    swinging = [
        "geometry.cells='simplex'",
        "geometry.parameters.elements_along=40",
        "material.mass_damping=0.0",
        "basis.derivatives='all'",
        "contacts=[]",
        "probe={nearest=[2.54, 0.0127, 0.0127]}",
        "reference={}",
        "time={steps_per_period=200, periods=3, steady='march', steady_tolerance=0.0}",
    ]
    what = "beam that swings by 0.45 m, 600 steps from rest"
    yield "swinging", what, read_scene(DEMOS / "slip_liftoff_3d.toml", swinging)


def numbers(scene: Any, printed: bool) -> dict[str, list[float]]:
    """The natural frequencies in Hz, and the displacement of the probe in m, of this program."""
    import numpy as np
    from mpi4py import MPI

    from fenicsrom import build_solid
    from fenicsrom.assess.rotation.disk_modes import wave_modes
    from fenicsrom.fem.solid.wave import wave

    solid, squares = build_solid(scene, MPI.COMM_SELF), np.zeros(0)
    for h in scene.cyclic.waves if scene.cyclic else ():
        with wave(solid, h) as body:
            squares = np.append(squares, wave_modes(body, scene.basis.modes)[0])
    # CalculiX has another stiffness of follower pressures, so only the deflections are comparable
    if scene.cyclic is None and not scene.followers:
        squares = solid.eigenmodes(solid.factor, MODES)[0]
    moved = solid.probe_rows @ solid.equilibrium if printed and solid.loaded else np.zeros(0)
    return {
        "frequencies": (np.sqrt(squares) / (2.0 * np.pi)).tolist(),
        "deflection": moved.tolist(),
    }


def motions(scene: Any) -> dict[str, dict[str, Any]]:
    """The displacement of the probe at all steps of both models, m, and their seconds."""
    from mpi4py import MPI

    from fenicsrom import build_model, build_solid
    from fenicsrom.fem.full.full import full_model
    from fenicsrom.online.run.simulate import simulate

    full = simulate(full_model(build_solid(scene, MPI.COMM_SELF)), scene)
    stored = build_model(scene)
    stored.simulate()  # compiles
    reduced = stored.simulate()
    named = {"full model": full, f"reduced model, {stored.size} coordinates": reduced}
    return {
        name: {"seconds": motion.seconds, "displacement": motion.displacement[1:, 0].tolist()}
        for name, motion in named.items()
    }


def compute(folder: Path) -> None:
    """Write the deck of each body, and the numbers of this program."""
    from unittest.mock import patch

    from fenicsrom import __version__
    from fenicsrom.exchange.calculix import write_deck
    from fenicsrom.exchange.deck import scene_deck

    found: dict[str, Any] = {}
    for name, what, scene in cases(folder):
        deck = scene_deck(scene)
        write_deck(folder / f"{name}.inp", deck)
        printed = len(deck.printed) == 1
        mesh = f"{len(deck.mesh.blocks[0].nodes)} {deck.element}"
        found[name] = {"what": what, "mesh": mesh, "ours": numbers(scene, printed)}
        if deck.element in ("C3D10", "CPE6"):
            with patch("fenicsrom.fem.body.elasticity.quadrature_degree", lambda domain: 2):
                found[name]["degree 2"] = numbers(scene, printed)
        if deck.transient is not None:
            found[name]["motions"] = motions(scene)
        print(f"{name}: {mesh}", file=sys.stderr, flush=True)
    content = {"version": __version__, "cases": found}
    (folder / NUMBERS).write_text(json.dumps(content, indent=2))


def run_ccx(program: str, deck: Path) -> dict[str, Any]:
    """The natural frequencies in Hz, displacement and motion of the probe in m, of CalculiX.

    Raises:
        RuntimeError: CalculiX did not give them.
    """
    done = subprocess.run([program, deck.stem], cwd=deck.parent, capture_output=True, text=True)
    output = deck.with_suffix(".dat")
    text = output.read_text() if output.is_file() else ""
    if done.returncode or "E I G E N" not in text or "JOB FINISHED" not in done.stdout.upper():
        raise RuntimeError(
            f"{program} did not finish {deck}; its output ends with:\n" + done.stdout[-500:]
        )
    before, after = (
        [words for line in part.splitlines() if (words := line.split()) and words[0].isdigit()]
        for part in text.split("E I G E N", 1)
    )
    moved, motion = (
        [[float(word) for word in words[1:]] for words in part if len(words) == 4]
        for part in (before, after)
    )
    rows = [words for words in after if len(words) == 5]
    # of a disk: diameter, number from 1, ..; each wave twice, as it goes around either way
    rows += [words for words in after if words[1].isdigit() and int(words[1]) % 2]
    return {
        "frequencies": [float(words[-2]) for words in rows],
        "deflection": moved[-1] if moved else [],
        "motion": motion,
    }


def distance(ours: list[list[float]], theirs: list[list[float]]) -> float:
    """Root mean square difference of two motions, relative to that of the second.

    Raises:
        RuntimeError: the motions have different numbers of steps.
    """
    if len(ours) != len(theirs):
        raise RuntimeError(f"a motion of {len(ours)} steps, and one of {len(theirs)}")
    apart = sum(math.dist(a, b) ** 2 for a, b in zip(ours, theirs, strict=True))
    return math.sqrt(apart / sum(math.hypot(*b) ** 2 for b in theirs))


def cpu_seconds() -> float:
    """CPU time of the programs that this one ran, s."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def compare(program: str, folder: Path) -> list[str]:
    """Run CalculiX on every deck, and give the lines of a table."""
    ours = json.loads((folder / NUMBERS).read_text())
    version = subprocess.run([program, "-v"], capture_output=True, text=True).stdout.split()[-1:]
    lines = [
        f"fenicsrom {ours['version']} and CalculiX {' '.join(version)}",
        "",
        "| body | elements | quantity | CalculiX | fenicsrom | | degree 2 | |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for name, case in ours["cases"].items():
        begin = cpu_seconds()
        answer = run_ccx(program, folder / f"{name}.inp")
        seconds, theirs = cpu_seconds() - begin, quantities(answer)
        mine, coarse = quantities(case["ours"]), quantities(case.get("degree 2", {}))
        for quantity, value in mine.items():
            other = theirs[quantity]
            row = [case["what"], case["mesh"], quantity, f"{other:.7g}"]
            for found in (value, coarse.get(quantity)):
                difference = None if found is None else found / other - 1.0
                row += ["", ""] if difference is None else [f"{found:.7g}", f"{difference:+.1e}"]
            lines.append(f"| {' | '.join(row)} |")
        for model, motion in case.get("motions", {}).items():
            apart = distance(motion["displacement"], answer["motion"])
            quantity = f"motion of the probe (rms) and seconds, {model}"
            times = [f"{seconds:.3g} s", f"{motion['seconds']:.3g} s", f"{apart:.1e}"]
            lines.append(f"| {' | '.join([case['what'], case['mesh'], quantity, *times])} | | |")
    return lines


def quantities(found: dict[str, list[float]]) -> dict[str, float]:
    """The numbers by their names, frequencies in Hz and displacements in mm."""
    modes = {f"mode {k}, Hz": f for k, f in enumerate(found.get("frequencies", ()), 1)}
    moved = zip("xyz", found.get("deflection", ()), strict=False)
    return modes | {f"{axis} of the probe, mm": 1e3 * value for axis, value in moved}


def main() -> int:
    """Compute, run CalculiX, and write the table."""
    parser = argparse.ArgumentParser(description="Compare this program with CalculiX.")
    parser.add_argument("--output", default="out/calculix", type=Path, metavar="DIR")
    folder = parser.parse_args().output
    folder.mkdir(parents=True, exist_ok=True)
    program = shutil.which("ccx")
    if program is None or not (folder / NUMBERS).is_file():
        try:
            compute(folder)
        except ImportError as error:
            first = f"run docker/run python3 {Path(__file__).name} --output {folder} first"
            print(f"{error}; {first}", file=sys.stderr)
            return 2
    if program is None:
        again = f"run this script where it is, with --output {folder}"
        print(f"ccx is not installed; the decks are in {folder}: {again}", file=sys.stderr)
        return 2
    try:
        lines = compare(program, folder)
    except (RuntimeError, OSError) as error:
        print(error, file=sys.stderr)
        return 1
    (folder / "comparison.md").write_text("\n".join([*lines, ""]))
    print("\n".join(lines))
    return 0


if __name__ == "__main__":
    sys.exit(main())
