"""Rigid surfaces beside contacts between bodies."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from support import refusal
from test_pairs import PAIR, STEEL, blocks, forces, lap, solid, stacked, struck

import fenicsrom as fr
from fenicsrom.errors import ErrorKind
from fenicsrom.fem.body.stress_points import stress_table
from fenicsrom.fem.full.full import full_model
from fenicsrom.fem.solid.reaction_rows import reaction_table
from fenicsrom.online.run.simulate import simulate
from fenicsrom.online.stress.reactions import Recovery, find_stresses
from fenicsrom.scene import make_scene


@pytest.mark.parametrize("nonlinear", [False, True], ids=["linear", "nonlinear"])
def test_column_on_a_wall_carries_the_pressure_in_each_contact(
    tmp_path: Path, nonlinear: bool
) -> None:
    """No support holds the column along its axis."""
    stiff = {"normal_stiffness": 1e14, "tangential_stiffness": 1e13, "friction": 0.3}
    scene = make_scene(
        geometrically_nonlinear=nonlinear,
        geometry={
            **{"mesh": str(stacked(tmp_path / "two.vtu", 2, 4, 3)), "dimension": 2},
            "thickness": 1.0,
        },
        material=STEEL | {"poisson": 0.0},
        supports=[{"node": [0.0, y], "components": ["x"]} for y in (0.025, 0.075)],
        contacts=[
            {"group": "0 low y", "at": "nodes", "normal": [0.0, -1.0], **stiff},
            {"group": "1 low y", "against": "0 high y", **stiff},
        ],
        loads=[{"group": "1 high y", "pressure": 1e6}],
        output={"stresses": "cauchy"},
        time={"duration": 1.0, "step": 0.1},
    )
    body = solid(scene)
    for k in range(2):
        assert forces(body)[body.points.contact == k].sum() == pytest.approx(1e5, rel=1e-9)
    top = body.mesh.nodes("1 high y", body.space)
    expected = -1e6 * (0.1 / 210e9 + 2e-14)
    np.testing.assert_allclose(body.equilibrium[2 * top + 1], expected, rtol=6e-5)
    nothing = np.zeros((body.local, 0))
    table = stress_table(body, scene, body.equilibrium, nothing)
    recovery = Recovery(table, reaction_table(body, scene, nothing))
    found = find_stresses(recovery, scene, None, None, {})
    np.testing.assert_allclose(found.reactions.by_momentum[0], [0.0, 0.0], atol=1e-6)


def strips(path: Path, *contacts: Any) -> Any:
    """Two cantilevers above one another; the tip of the upper one rubs on a wall above it."""
    parts = [((0.0, y), (0.3, y + 0.01), (4, 1)) for y in (0.0, 0.011)]
    stiff = {"normal_stiffness": 1e6, "tangential_stiffness": 1e6, "friction": 0.3}
    wall = {"node": [0.3, 0.021], "normal": [0.0, 1.0], "preload": 5.0, **stiff}
    return make_scene(
        geometrically_nonlinear=False,
        geometry={"mesh": str(blocks(path, *parts)), "dimension": 2, "thickness": 0.02},
        material=STEEL | {"mass_damping": 5.0},
        supports=[{"group": f"{k} low x"} for k in range(2)],
        contacts=[wall, *(contact | stiff for contact in contacts)],
        loads=[{"group": "1 high x", "direction": [0.3, 1.0], "force": 5.0, "frequency": 60.0}],
        probe={"group": "1 high x"},
        time={"periods": 1, "steps_per_period": 60, "steady": "march"},
    )


def test_bodies_that_never_touch_change_no_contact_with_a_wall(tmp_path: Path) -> None:
    far = {"group": "1 low y", "against": "0 high y", "gap": 0.1}
    alone, beside = (
        simulate(full_model(solid(scene)), scene)
        for scene in (strips(tmp_path / "strips.vtu", *more) for more in ((), (far,)))
    )
    assert alone.friction_dissipation[-1] > 0.0 and np.any(alone.force[:, 0, 0] == 0.0)
    assert not beside.force[:, 1:].any()
    for name, rows in (("force", np.s_[:, 0]), ("probe", np.s_[:])):
        one, other = getattr(alone, name)[rows], getattr(beside, name)[rows]
        np.testing.assert_allclose(other, one, rtol=0.0, atol=1e-10 * np.abs(one).max())


@pytest.mark.slow
def test_joint_whose_tip_rubs_on_a_wall_moves_as_the_full_model() -> None:
    wall = {"node": [0.5, 0.01], "normal": [0.0, -1.0], "friction": 0.2, "preload": 20.0}
    scene = struck(
        10.0,
        contacts=[PAIR, wall | {"normal_stiffness": 1e5, "tangential_stiffness": 1e5}],
        time={"duration": 0.03, "step": 1e-4},
        basis={"modes": 30, "accuracy": 1e-6},
        reference={"full": True},
        output={"pictures": False, "paraview": False, "stresses": "cauchy"},
    )
    found = fr.run(scene, MPI.COMM_SELF)
    reduced, full = found.motions["reduced"], found.motions["full"]
    pressed = full.force[:, -1, 0]
    assert pressed.min() == 0.0 and found.unfinished is None
    force = np.interp(full.time, reduced.time, reduced.force[:, -1, 0])
    assert np.linalg.norm(force - pressed) < 1e-5 * np.linalg.norm(pressed)
    spent, expected = (each.friction_dissipation[-1] for each in (reduced, full))
    assert spent == pytest.approx(expected, rel=1e-4)
    assert full.newton_iterations < 4.0 * full.steps and full.relative_imbalance < 1e-9
    reactions = found.stresses.motion_reactions
    at_first = reactions.values[0, 0, :2], reactions.by_momentum[0]
    np.testing.assert_allclose(*at_first, atol=6e-3)  # N, of 1.5 N; 73 N in the motion
    assert reactions.mismatch < 0.025


def test_round_surface_must_not_press_on_bodies_at_rest() -> None:
    ball = {"kind": "cylinder", "point": [0.5, -1.0]}
    wall = {"node": [0.5, 0.01], "surface": ball, "friction": 0.2, "preload": 20.0}
    scene = lap(contacts=[PAIR, wall | {"normal_stiffness": 1e5, "tangential_stiffness": 1e5}])
    with refusal(ErrorKind.CONFLICT, "contacts[1].surface", names="before the motion begins"):
        solid(scene)
