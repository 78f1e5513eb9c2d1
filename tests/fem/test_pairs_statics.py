"""Paths of equilibria of bodies that touch."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from support import assert_tangent
from test_pairs import COARSE, PAIR, bars, blocks, forces, lap, scene_of, solid, stacked

import fenicsrom as fr
from fenicsrom.assess.curves import equilibrium_path
from fenicsrom.cli import main
from fenicsrom.errors import ConvergenceError
from fenicsrom.notes import STABILITY, NoteKind, has_kind, verdict_of
from fenicsrom.online.contact.state import OPEN, SLIP, STICK
from fenicsrom.scene import Load, Scene, Statics, toml_text

pytestmark = pytest.mark.slow


def pulled(load: float, friction: float, *contacts: Any) -> Scene:
    """The lap joint whose tip a static force lifts."""
    return lap(
        geometry=COARSE,
        contacts=[PAIR | {"friction": friction}, *contacts],
        loads=[{"group": "tip", "direction": [0, 1], "force": load}],
        probe={"group": "tip"},
        time={"duration": 1.0, "step": 0.1},
    )


@pytest.mark.parametrize(
    ("rigid", "moved", "loss"),
    [(False, 4.925484186e-6, 9.988785433e-4), (True, 3.484267291e-6, 2.077023044e-3)],
    ids=["two bars", "one bar"],
)
def test_bars_that_a_growing_force_pulls_slip_as_the_closed_form_says(
    tmp_path: Path, rigid: bool, moved: float, loss: float
) -> None:
    """Reference: two bars and one pulled from rest: displacement, friction | closed form |
    4.92548, 3.48427 µm; 0.249720, 0.519256 mJ | 0.07, 0.29 %; 0.5, 0.07 % | 0.4 %; 1 %

    The loop of a period has four times the friction (Masing).
    """
    scene = bars(tmp_path / "bars.vtu", rigid)
    pull = Load.of(group="1 high x", direction=[1.0, 0.0], force=594.0)
    found = fr.statics(replace(scene, loads=(pull,), geometrically_nonlinear=True), MPI.COMM_SELF)
    last = found.points[-1]
    assert (found.reason, found.unfinished, found.special) == ("end of the range", None, [])
    assert last.probe[0] == pytest.approx(moved, rel=4e-3)
    assert 4.0 * last.dissipated == pytest.approx(loss, rel=1e-2)
    assert 30 <= last.slipping < last.closed == 41
    (note,) = [note for note in found.warnings if note.quantity == STABILITY]
    assert note.kind is NoteKind.REMARK  # no negative pivots, and half the steps agree
    assert verdict_of(found.warnings, quantities=[STABILITY]).kind == "trusted"


def test_stability_with_friction_that_half_the_steps_change_is_in_doubt(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(equilibrium_path, "HALVED", 1e-9)
    pull = Load.of(group="1 high x", direction=[1.0, 0.0], force=594.0)
    scene = replace(bars(tmp_path / "bars.vtu", True), loads=(pull,), geometrically_nonlinear=True)
    found = fr.statics(scene, MPI.COMM_SELF)
    assert has_kind([n for n in found.warnings if n.quantity == STABILITY], NoteKind.WARNING)


def test_path_without_friction_ends_in_the_equilibrium_under_the_load() -> None:
    """Points open and close on the way; the solid finds its closed points without a path."""
    scene = pulled(60.0, friction=0.0)
    last, body = fr.statics(scene, MPI.COMM_SELF).points[-1], solid(scene)
    np.testing.assert_allclose(last.probe, body.probe_rows @ body.equilibrium, atol=7e-11)
    assert last.closed == np.sum(forces(body) > 0.0) != 6  # 6 at the start
    assert last.dissipated == 0.0


def test_path_turns_at_once_where_the_body_meets_a_wall() -> None:
    stop = {"node": [0.5, 0.02], "normal": [0.0, 1.0], "gap": 2e-3, "friction": 0.2}
    stop |= {"normal_stiffness": 1e7, "tangential_stiffness": 1e7}
    found = fr.statics(pulled(60.0, 0.3, stop), MPI.COMM_SELF)
    met = next(point for point in found.points if point.states[-1] != OPEN)
    last = found.points[-1]
    force = 1e7 * (last.contact[-1, 0] - 2e-3)
    assert force == pytest.approx(60.0 * (1.0 - met.load_factor), rel=6e-3)  # the stop is stiff
    assert found.reason == "end of the range" and not found.special
    assert found.points[0].dissipated < met.dissipated < last.dissipated < 1.05 * met.dissipated


def test_tangent_of_contacts_on_a_path_is_the_derivative_of_their_force() -> None:
    """Points stick and slip; those at the corner of the law are left out."""
    body = solid(pulled(60.0, 0.3))
    joint, moved = body.let_rub(), 1e-7 * np.random.default_rng(0).standard_normal(body.local)
    u = body.equilibrium + moved
    assert {*joint.states(u)} == {OPEN, SLIP, STICK}
    matrix = joint.tangent(u, symmetric=False)
    assert_tangent(joint.force, lambda u: joint.tangent(u, False).toarray(), u, step=1e-10)
    with_limits = joint.tangent(u, symmetric=True)
    assert abs(with_limits - with_limits.T).max() < 1e-9 * abs(matrix).max()
    assert abs(with_limits - matrix).max() > 1e-3 * abs(matrix).max()


def test_path_ends_where_friction_no_longer_holds_the_body(tmp_path: Path) -> None:
    """The upper block slides as a whole at μ N = 0.1 · 100 kN. Without the pressure it is free."""
    scene = scene_of(
        stacked(tmp_path / "two.vtu", 2, 3, 2),
        2,
        {"group": "1 low y", "against": "0 high y", "friction": 0.1},
        geometrically_nonlinear=True,
        supports=[{"group": "0 low y"}],
        loads=[
            {"group": "1 high y", "pressure": 1e6},
            {"group": "1 high x", "direction": [1.0, 0.0], "force": 1e5},
        ],
        statics={"loads": [1]},
        time={"duration": 1.0, "step": 0.1},
    )
    found = fr.statics(scene, MPI.COMM_SELF)
    last = found.points[-1]
    assert (found.reason, found.unfinished, found.special) == ("sliding", None, [])
    assert last.load_factor == pytest.approx(0.1, rel=1e-9)
    assert last.slipping == last.closed > 0 and found.direction == 0  # not that of the pressure
    with pytest.raises(
        ConvergenceError, match=r"at the load factor 0, without loads\[0\]: the cont"
    ):
        fr.statics(replace(scene, statics=Statics(loads=(0,))), MPI.COMM_SELF)


def test_path_begins_with_plates_that_just_touch(tmp_path: Path) -> None:
    plates = [((0.0, y), (0.2, y + 0.005), (n, 1)) for y, n in ((0.0, 10), (0.005, 12))]
    scene = scene_of(
        blocks(tmp_path / "plates.vtu", *plates),
        2,
        {"group": "1 low y", "against": "0 high y", "friction": 0.0, "normal_stiffness": 1e13},
        2,
        geometrically_nonlinear=True,
        supports=[{"group": f"{k} low x"} for k in range(2)],
        loads=[{"group": "1 high y", "pressure": 2e3}],
        probe={"group": "1 high x"},
        time={"duration": 1.0, "step": 0.1},
    )
    found, body = fr.statics(scene, MPI.COMM_SELF), solid(scene)
    assert (found.reason, found.unfinished) == ("end of the range", None)
    np.testing.assert_allclose(
        found.points[-1].probe, body.probe_rows @ body.equilibrium, rtol=1e-7
    )


def test_bodies_that_touch_need_no_times_where_nothing_moves(tmp_path: Path) -> None:
    table = tomllib.loads(Path("demos/lap_joint.toml").read_text())
    table |= {
        "loads": [{"group": "tip", "direction": [0, 1], "force": 10.0}],
        "output": {"pictures": False},
    }
    del table["time"], table["title"]
    table["geometry"]["mesh"] = str(Path("meshes/lap2d.geo").absolute())
    scene = tmp_path / "lap.toml"
    scene.write_text(toml_text(table))
    for command in ("modes", "statics"):
        assert main([command, str(scene), "--output", str(tmp_path / command)]) == 0
    assert main(["run", str(scene), "--output", str(tmp_path / "run")]) == 2
