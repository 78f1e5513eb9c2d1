"""Joints: reduced models beside full ones, the mesh of the contact, and the cost.

    python3 tests/evidence/joints.py [NAME ...]

prints a row for each joint of `JOINTS`: contact points and coordinates; the errors of the reduced
motion against the full model, in %, of the loss by friction, of the history of the probe and of the
size of its motion; the estimates of the run, in %, by the basis (loss, size and history) and by the
mesh (loss); and the iterations of a step, reduced and full. The first three chose the method; the
others did not. "mesh" prints the loss of a lap joint on three meshes, and "cost" the CPU time and
memory of a plate with 510 contact points.
"""

from __future__ import annotations

import resource
import sys
import time
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import meshio
import numpy as np
from numpy.typing import NDArray

import fenicsrom as fr
from fenicsrom.assess.errors.estimates import MotionErrors, with_further
from tests.evidence.measured import merged

Array = NDArray[np.float64]
STEEL = {"young": 210e9, "poisson": 0.3, "density": 7800.0}
QUIET = {"pictures": False, "paraview": False}


def lap(folder: Path, overlap: int = 12, lower: int = 12) -> dict[str, Any]:
    """Two strips with two bolts in the plane; a push of 60 N moves the end by ten heights."""
    cells = {"elements_overlap": overlap, "elements_lower": lower}
    pair = {"group": "upper", "against": "lower", "friction": 0.3}
    return {
        "geometry": {"mesh": "lap2d.geo", "dimension": 2, "thickness": 0.02, "parameters": cells},
        "supports": [{"group": "root"}],
        "contacts": [{**pair, "normal_stiffness": 2e13, "tangential_stiffness": 1e13}],
        "bolts": [{"head": f"head{k}", "nut": f"nut{k}", "force": 4000.0} for k in (1, 2)],
        "loads": [push([0.0, 1.0], 60.0, 0.015, node=[0.5, 0.02])],
        "probe": {"node": [0.5, 0.02]},
        "time": {"duration": 0.2, "step": 2e-4},
        "basis": {"size": 30},
    }


def push(direction: list[float], force: float, duration: float, **place: Any) -> dict[str, Any]:
    """Half a sine of a force at a place."""
    pulse = {"duration": duration}
    return {**place, "direction": direction, "force": force, "pulse": pulse}


def write(folder: Path, bodies: Any, groups: Callable[..., dict[str, Any]]) -> dict[str, Any]:
    """Write the mesh of bodies, with groups by coordinates and body; the geometry."""
    points, cells, body = merged(bodies)
    data = {name: at.astype(int) for name, at in groups(*points.T.round(9), body).items()}
    meshio.Mesh(points, [("hexahedron", cells)], point_data=data).write(folder / "joint.vtk")
    return {"mesh": "joint.vtk", "dimension": 3}


def plate(
    folder: Path,
    cells: tuple[int, int, int, int] = (16, 2, 1, 1),
    force: float = 20.0,
    friction: float = 0.3,
    along: tuple[float, float, float] = (0.0, 1.0, 0.0),
) -> dict[str, Any]:
    """A strip of 1.5 mm, both ends pressed on blocks with 6 kN, and pushed in the middle.

    `cells` are those along the span, along each end, across and through the strip.
    """
    span, end, wide, through = cells
    lengths = (0.0, 0.03, end), (0.03, 0.33, span), (0.33, 0.36, end)
    x = [np.linspace(first, last, n + 1) for first, last, n in lengths]
    y, z = np.linspace(0.01, 0.0115, through + 1), np.linspace(0.0, 0.03, wide + 1)
    base = np.linspace(0.0, 0.01, through + 1)
    below = [np.linspace(part[0], part[-1], max(1, end - 1) + 1) for part in (x[0], x[2])]
    bodies = [[(part, y, z) for part in x], *([(part, base, z)] for part in below)]

    def groups(x: Array, y: Array, z: Array, body: Any) -> dict[str, Any]:
        ends = (x <= 0.03) | (x >= 0.33)  # the blocks have larger cells
        strip = body == 0
        return {
            "foot": y == 0.0,
            "under": strip & ends & (y == 0.01),
            "seat": ~strip & (y == 0.01),
            "press": strip & ends & (y == 0.0115),
        }

    middle = [0.18, 0.0115, 0.015]
    return {
        "geometry": write(folder, bodies, groups),
        "supports": [{"group": "foot"}],
        "contacts": [
            {
                **{"group": "under", "against": "seat", "friction": friction},
                **{"normal_stiffness": 2e12, "tangential_stiffness": 1e12},
            }
        ],
        "loads": [
            {"group": "press", "pressure": 6000.0 / 0.03**2},
            push(list(along), force, 0.005, node=middle),
        ],
        "probe": {"node": middle},
        "time": {"duration": 0.1, "step": 0.1 / 1500},
    }


def sandwich(folder: Path) -> dict[str, Any]:
    """A strip between two plates, with a bolt through all, pushed obliquely: two contacts."""
    z, lap = np.linspace(0.0, 0.03, 3), np.linspace(0.08, 0.12, 4)
    arm, root = np.linspace(0.12, 0.28, 7), np.linspace(0.0, 0.08, 4)
    y = [np.array([a, a + 0.005]) for a in (0.0, 0.005, 0.01)]
    outer = [[(root, layer, z), (lap, layer, z)] for layer in (y[0], y[2])]
    bodies = [[(lap, y[1], z), (arm, y[1], z)], *outer]

    def groups(x: Array, y: Array, z: Array, body: Any) -> dict[str, Any]:
        bolt = (x > 0.09) & (x < 0.11)
        return {
            "root": x == 0.0,
            "below": (body == 0) & (x <= 0.12) & (y == 0.005),
            "above": (body == 0) & (x <= 0.12) & (y == 0.01),
            "lower": (body == 1) & (y == 0.005) & (x >= 0.08),
            "upper": (body == 2) & (y == 0.01) & (x >= 0.08),
            "head": bolt & (y == 0.015),
            "nut": bolt & (y == 0.0),
        }

    tip = [0.28, 0.01, 0.015]
    law = {"friction": 0.15, "normal_stiffness": 1e13, "tangential_stiffness": 5e12}
    pairs = (("below", "lower"), ("above", "upper"))
    return {
        "geometry": write(folder, bodies, groups),
        "supports": [{"group": "root"}],
        "contacts": [{"group": a, "against": b, **law} for a, b in pairs],
        "bolts": [{"head": "head", "nut": "nut", "force": 9000.0}],
        "loads": [push([0.0, 0.8, 0.6], 120.0, 0.003, node=tip)],
        "probe": {"node": tip},
        "time": {"duration": 0.03, "step": 5e-5},
    }


JOINTS: dict[str, Callable[[Path], dict[str, Any]]] = {
    "lap": lap,
    "lap, 60 points": lambda folder: lap(folder, 30, 24),
    "plate": lambda folder: plate(folder) | {"basis": {"size": 20}},
    "plate, oblique": lambda folder: plate(
        folder, force=60.0, friction=0.15, along=(0.2, 0.9, 0.4)
    ),
    "sandwich": sandwich,
}


def run(make: Callable[[Path], dict[str, Any]], full: bool = True) -> Any:
    """The run of a joint, with the full model beside."""
    with TemporaryDirectory() as folder:
        table = {"material": STEEL, "output": QUIET, "reference": {"full": full}}
        return fr.run(fr.parse_scene(table | make(Path(folder)), "joint", Path(folder)))


def apart(motion: Any, full: Any) -> tuple[float, float, float]:
    """Relative errors of loss, history and size of the motion of the probe by the full model."""
    near = [np.interp(full.time, motion.time, one) for one in motion.probe.T]
    moved = np.linalg.norm(np.transpose(near) - full.probe) / np.linalg.norm(full.probe)
    loss = motion.friction_dissipation[-1] / full.friction_dissipation[-1] - 1.0
    size = with_further(MotionErrors(0.0, 0.0, ()), motion, full, 1.0).probe
    return float(loss), float(moved), size


def acceptance(name: str) -> None:
    """Print the row of a joint."""
    found = run(JOINTS[name])
    reduced, full, errors = found.motions["reduced"], found.motions["full"], found.errors
    loss, moved, size = (100.0 * value for value in apart(reduced, full))
    steps = [motion.newton_iterations / motion.steps for motion in (reduced, full)]
    basis, mesh = errors["basis"], errors["mesh"]
    found_by = basis.dissipation, basis.probe, basis.history, mesh.dissipation
    said = [100.0 * value for value in found_by]
    print(
        f"| {name} | {found.points.contact.size} | {found.basis.size} | {loss:+.2f} | {moved:.2f} "
        f"| {size:.2f} | {said[0]:.2f} | {said[1]:.2f} | {said[2]:.2f} | {said[3]:.1f} "
        f"| {steps[0]:.1f} | {steps[1]:.1f} |",
        flush=True,
    )


def mesh() -> None:
    """Print the loss of the lap joint, and its estimated error by the mesh, on three meshes."""
    for cells in (6, 12, 24):
        found = run(lambda folder, n=cells: lap(folder, n, n) | {"basis": {}}, full=False)
        loss = found.motions["reduced"].friction_dissipation[-1]
        error = 100.0 * found.errors["mesh"].dissipation
        print(f"| {cells} | {found.points.contact.size} | {loss:.4e} | {error:.1f} |", flush=True)


def cost() -> None:
    """Print what the plate costs with 510 contact points and 100,000 unknowns."""
    for cells in ((16, 2, 1, 1), (166, 7, 8, 2)):  # the first model compiles
        with TemporaryDirectory() as folder:
            table = {"material": STEEL, "output": QUIET} | plate(Path(folder), cells)
            scene = fr.parse_scene(table | {"basis": {"size": 40}}, "joint", Path(folder))
            begin = time.process_time()
            stored = fr.build_model(scene, fresh=True)
    spent, peak = time.process_time() - begin, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    print(f"{stored.dofs} unknowns, {stored.model.points.contact.size} points: {spent:.0f} CPU s")
    print(f"{peak / 1e6:.1f} GB, {stored.size} coordinates", flush=True)
    for _ in range(2):  # the first motion compiles
        motion = stored.simulate()
    print(f"{1e3 * motion.seconds / motion.steps:.2f} ms per step")


def main(names: list[str]) -> None:
    """Print the rows of joints, or of all."""
    for name in names or [*JOINTS, "mesh", "cost"]:
        if name in JOINTS:
            acceptance(name)
        else:
            {"mesh": mesh, "cost": cost}[name]()


if __name__ == "__main__":
    main(sys.argv[1:])
