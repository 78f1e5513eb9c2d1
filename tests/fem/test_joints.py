"""Joints against closed forms: blocks, a wedge, cylinders, a lap joint, exchanged bodies."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest

pytest.importorskip("dolfinx")
from mpi4py import MPI
from numpy.typing import NDArray

import fenicsrom as fr
from tests.fem.test_pairs import BOLT, blocks, hertz, lap, solid, struck

pytestmark = pytest.mark.slow

Array = NDArray[np.float64]
RIGID = {"young": 1e16, "poisson": 0.0, "density": 100.0, "mass_damping": 1e4}
LAST = {"periods": 2, "steps_per_period": 200, "steady": "march"}
QUIET = {"pictures": False, "paraview": False}


def loop(scene: Any) -> tuple[Array, float]:
    """Half ranges of the probe in the last period, and the loss of this period, J."""
    motion = fr.build_model(scene, comm=MPI.COMM_SELF).simulate()
    last = motion.last_period()
    spent = motion.friction_dissipation[last]
    return 0.5 * np.ptp(motion.probe[last], axis=0), float(spent[-1] - spent[0])


def test_block_that_slides_on_another_is_a_jenkins_element(tmp_path: Path) -> None:
    """4 μN (u − μN/k) of 600 N and 8e8 N/m, beside a spring to the ground (test A).

    Reference: sliding blocks: loss | closed form | – | agrees | 4e-5
    """
    parts = [((0.0, y), (0.2, y + 0.005), (4, 1)) for y in (0.0, 0.005)]
    pair = {"group": "1 low y", "against": "0 high y", "friction": 0.3, "preload": 0.5e6}
    end = {"group": "1 high x"}
    scene = fr.make_scene(
        geometrically_nonlinear=False,
        geometry={"mesh": str(blocks(tmp_path / "a.vtu", *parts)), "dimension": 2}
        | {"thickness": 0.02},
        material=RIGID,
        supports=[{"group": "0 low y"}, {"group": "1 high y", "components": ["y"]}],
        contacts=[{**pair, "normal_stiffness": 2e12, "tangential_stiffness": 2e11}],
        attachments=[{**end, "stiffness": 5e8, "components": ["x"]}],
        loads=[{**end, "direction": [1, 0], "force": 1600.0, "frequency": 1.0}],
        probe=end,
        basis={"modes": 1, "masters": "all"},
        time=LAST,
        output=QUIET,
    )
    moved, spent = loop(scene)
    assert moved[0] == pytest.approx(2e-6, rel=7e-4)
    assert spent == pytest.approx(4.0 * 600.0 * (moved[0] - 600.0 / 8e8), rel=4e-5)


def wedge_mesh(path: Path, angle: float) -> Path:
    """A wedge of 20 mm between two platforms; its faces are at an angle to its height."""
    low, high, end = 0.02, 0.02 - 0.02 * np.tan(angle), 0.04
    quads = [
        [(-low, 0.0), (low, 0.0), (high, 0.02), (-high, 0.02)],
        [(low, 0.0), (end, 0.0), (end, 0.02), (high, 0.02)],
        [(-end, 0.0), (-low, 0.0), (-high, 0.02), (-end, 0.02)],
    ]
    points, cells = [], []
    s, t = (a.ravel() for a in np.meshgrid(np.linspace(0, 1, 3), np.linspace(0, 1, 3)))
    weights = np.array([(1 - s) * (1 - t), s * (1 - t), s * t, (1 - s) * t]).T
    for k, corners in enumerate(quads):
        points.append(weights @ np.array(corners))
        cells += [[9 * k + n for n in (i, i + 1, i + 4, i + 3)] for i in (0, 1, 3, 4)]
    sides = {"right": [2, 5, 8], "left": [0, 3, 6], "top": [6, 7, 8], "foot": [0, 1, 2]}
    named = {
        **{"wedge right": (0, "right"), "wedge left": (0, "left"), "wedge foot": (0, "foot")},
        **{"platform right": (1, "left"), "platform left": (2, "right")},
        **{"end right": (1, "right"), "end left": (2, "left")},
        **{"foot right": (1, "foot"), "foot left": (2, "foot")},
    }
    marks = {}
    for name, (k, side) in named.items():
        marks[name] = np.isin(np.arange(27), 9 * k + np.array(sides[side])).astype(int)
    x = np.pad(np.concatenate(points), ((0, 0), (0, 1)))
    meshio.Mesh(x, [("quad", np.array(cells))], point_data=marks).write(path)
    return path


def test_wedge_damper_has_the_forces_and_the_loss_of_the_closed_form(tmp_path: Path) -> None:
    """On a platform ½C cot(α ± φ) as it opens and closes; ΔH (2U − ΔH/K) a face (test D).

    Reference: wedge damper: loss | closed form | 9.784 mJ | agrees | 0.05 %
    """
    angle, spring, thickness = np.radians(40.0), 5e7, 0.01
    area = 0.02 / np.cos(angle) * thickness
    law = {"normal_stiffness": 2e7 / area, "tangential_stiffness": 1.2e7 / area, "friction": 0.3}
    ends = {"end right": 1.0, "end left": -1.0}
    scene = fr.make_scene(
        geometrically_nonlinear=False,
        geometry={"mesh": str(wedge_mesh(tmp_path / "w.vtu", angle)), "dimension": 2, "degree": 1}
        | {"thickness": thickness},
        material=RIGID | {"young": 1e14},
        supports=[{"group": f"foot {side}", "components": ["y"]} for side in ("right", "left")],
        contacts=[
            {"group": f"wedge {side}", "against": f"platform {side}", **law}
            for side in ("right", "left")
        ],
        attachments=[{"group": n, "stiffness": spring, "components": ["x"]} for n in ends],
        loads=[
            {"group": "wedge foot", "direction": [0, 1], "force": 200.0},
            *(
                {"group": name, "direction": [sign, 0], "force": 1083.0, "frequency": 50.0}
                for name, sign in ends.items()
            ),
        ],
        probe={"group": "end right"},
        basis={"modes": 2, "masters": "all"},
        time=LAST | {"periods": 3},
        output=QUIET,
    )
    moved, spent = loop(scene)
    change, stuck = 232.188971567 - 65.689610475, 1.568073266e7
    assert moved[0] == pytest.approx(2e-5, rel=1.2e-3)
    assert spent == pytest.approx(2.0 * change * (2.0 * moved[0] - change / stuck), rel=5e-4)


@pytest.mark.parametrize(
    ("force", "half_range", "loss"),
    [(10.0, 1.09107770e-3, 4.5219e-5), (30.0, 3.27484602e-3, 8.3488e-4)],
)
def test_lap_joint_dissipates_as_an_independent_program(
    force: float, half_range: float, loss: float
) -> None:
    """Reference: lap joint, slow force: half range, loss | another program | 3.27485 mm; 835 µJ |
    agree | 0.1 %; 1 %
    """
    scene = lap(
        geometrically_nonlinear=False,
        material={"young": 210e9, "poisson": 0.3, "density": 7800.0, "mass_damping": 20.0},
        loads=[{"node": [0.5, 0.02], "direction": [0, 1], "force": force, "frequency": 0.5}],
        basis={"modes": 3, "masters": "all"},
        time=LAST | {"steps_per_period": 1000},
        output=QUIET,
    )
    moved, spent = loop(scene)
    assert moved[1] == pytest.approx(half_range, rel=1e-3)
    assert spent == pytest.approx(loss, rel=1e-2)


def test_exchange_of_bodies_changes_frequencies_by_less_than_finer_cells() -> None:
    found = []
    for upper, lower in ((12, 18), (24, 30)):
        cells = {"elements_overlap": upper, "elements_lower": lower}
        geometry = {"mesh": "lap2d.geo", "dimension": 2, "thickness": 0.02, "parameters": cells}
        options = {"geometrically_nonlinear": False, "geometry": geometry}
        pairs = ("upper", "lower"), ("lower", "upper")
        found.append([hertz(solid(lap(*pair, **options)), 3) for pair in pairs])
    coarse, fine = np.array(found)
    exchanged, refined = np.abs(fine[0] - fine[1]), np.abs(coarse[0] - fine[0])
    assert np.all((exchanged > 0.0) & (exchanged < refined))


def graded(cell: float, count: int, end: float) -> Array:
    """Lines from 0 to an end: a number of equal cells, then cells that grow."""
    fine = cell * np.arange(count + 1)
    growing = np.cumsum(cell * 1.35 ** np.arange(1, 40))
    growing = growing[: 1 + np.searchsorted(growing, end - fine[-1])]
    return np.append(fine, fine[-1] + growing * (end - fine[-1]) / growing[-1])


def cylinders(path: Path, radius: float, cell: float) -> Path:
    """Two blocks of 10 x 5 mm with faces of a radius, which touch in a line."""
    half, y = graded(cell, round(3e-4 / cell), 5e-3), graded(cell, 4, 5e-3)
    x = np.append(-half[:0:-1], half)
    points, cells, marks = [], [], {}
    for k, side in enumerate((-1.0, 1.0)):
        at_x, at_y = np.meshgrid(x, y, indexing="ij")
        height = side * (at_y + at_x**2 / (2.0 * radius) * (1.0 - at_y / y[-1]))
        points.append(np.stack([at_x.ravel(), height.ravel(), 0.0 * at_x.ravel()], axis=1))
        number = np.arange(at_x.size).reshape(at_x.shape) + k * at_x.size
        ring = [number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]]
        cells.append(np.stack(ring[:: int(side)], axis=-1).reshape(-1, 4))
        marks |= {f"face{k}": number[np.abs(x) < 4.5e-4, 0], f"back{k}": number[:, -1]}
    every = np.concatenate(points)
    data = {name: np.isin(np.arange(len(every)), on).astype(int) for name, on in marks.items()}
    meshio.Mesh(every, [("quad", np.concatenate(cells))], point_data=data).write(path)
    return path


def test_pressed_cylinders_dissipate_as_cattaneo_and_mindlin_say(tmp_path: Path) -> None:
    """D = 4μ²P²/πE* [(1 − φ) ln(1 − φ) + φ − φ²/2], φ = Q/μP (test C); stiff springs press.

    Reference: pressed cylinders: loss | closed form | 1.660 mJ | 5.6 %; 0.9 % on half the cells |
    6 %
    """
    young, friction, radius = 210e9, 0.4, 0.05
    effective, back = 0.5 * young, {"group": "back1"}
    normal = 100.0 * effective / 2.5e-4
    pair = {"group": "face1", "against": "face0", "friction": friction}
    scene = fr.make_scene(
        geometrically_nonlinear=False,
        geometry={"mesh": str(cylinders(tmp_path / "c.vtu", radius, 2e-5)), "dimension": 2}
        | {"degree": 1, "thickness": 1.0},
        material={"young": young, "poisson": 0.3, "density": 7800.0, "mass_damping": 1e5},
        supports=[{"group": "back0"}],
        contacts=[{**pair, "normal_stiffness": normal, "tangential_stiffness": 0.5 * normal}],
        attachments=[
            {**back, "stiffness": size, "components": [axis]}
            for axis, size in (("y", 1e13), ("x", 1e6))
        ],
        loads=[
            {**back, "direction": [0, -1], "force": 5.6e7},
            {**back, "direction": [1, 0], "force": 4e4, "frequency": 50.0},
        ],
        probe=back,
        basis={"modes": 2, "masters": "all"},
        time=LAST,
        output=QUIET,
    )
    motion = fr.build_model(scene, comm=MPI.COMM_SELF).simulate()
    last = motion.last_period()
    pressed, pulled = motion.force[last].sum(axis=1).T
    limit = friction * float(np.mean(pressed))
    phi = 0.5 * float(np.ptp(pulled)) / limit
    shape = (1.0 - phi) * np.log(1.0 - phi) + phi - 0.5 * phi**2
    spent = motion.friction_dissipation[last]
    expected = 4.0 * limit**2 / (np.pi * effective) * shape
    assert phi == pytest.approx(0.4, abs=0.01)
    assert spent[-1] - spent[0] == pytest.approx(expected, rel=0.06)


def test_small_load_beside_large_bolt_forces_keeps_the_energy_balance() -> None:
    """2 N beside bolts of 100 kN: the response to the whole contact force cancelled the digits."""
    scene = struck(
        2.0,
        bolts=[BOLT | {"head": "head1", "nut": "nut1", "force": 1e5}, BOLT | {"force": 1e5}],
        loads=[{"group": "tip", "direction": [0, 1], "force": 2.0, "frequency": 5.0}],
        basis={"masters": "all"},
        time={"periods": 1, "steps_per_period": 100, "steady": "march"},
    )
    motion = fr.build_model(scene, comm=MPI.COMM_SELF).simulate()
    assert motion.contact_energy[0] > 1e3 * motion.kinetic.max() > 0.0
    assert motion.relative_imbalance < 1e-6
