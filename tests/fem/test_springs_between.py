"""Springs and dashpots between two places of a body, against closed forms."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("meshio")
pytest.importorskip("dolfinx")
import meshio
from mpi4py import MPI
from scipy.optimize import brentq
from support import refusal

import fenicsrom
from fenicsrom.errors import ErrorKind
from fenicsrom.exchange.deck import scene_deck
from fenicsrom.fem.full.full import full_model
from fenicsrom.fem.mesh.mesh import build_mesh
from fenicsrom.fem.solid.solid import solid_of
from fenicsrom.online.run.simulate import simulate
from fenicsrom.post.setup.setup import gathered_marks
from fenicsrom.reduction.modes import component_modes
from fenicsrom.scene import Basis

YOUNG, DENSITY, HEIGHT, THICKNESS = 2.1e11, 7800.0, 0.02, 0.01
AREA = HEIGHT * THICKNESS
SPEED = np.sqrt(YOUNG / DENSITY)
LENGTHS = 0.4, 0.6


def rods(path: Path, spring: dict[str, Any], cells: int = 6, **tables: Any) -> Any:
    """The scene of two rods along x, 0.1 m apart, which a spring connects; the first is clamped.

    Rollers hold both across.
    """
    x = [
        np.linspace(a, a + length, cells + 1) for a, length in zip((0.0, 0.5), LENGTHS, strict=True)
    ]
    x = np.concatenate(x)
    points = np.array([(a, y, 0.0) for y in (0.0, HEIGHT) for a in x])
    left = np.array([k for k in range(len(x) - 1) if k != cells])
    quads = np.stack([left, left + 1, left + 1 + len(x), left + len(x)], axis=1)
    sets = {"root": x == 0.0, "first": x == 0.4, "second": x == 0.5, "tip": x == x[-1]}
    data = {name: np.tile(at, 2).astype(int) for name, at in sets.items()}
    data["all"] = np.ones(len(points), dtype=int)
    meshio.Mesh(points, [("quad", quads)], point_data=data).write(path / "rods.vtk")
    table: dict[str, Any] = {
        "geometry": {"mesh": "rods.vtk", "dimension": 2, "thickness": THICKNESS},
        "material": {"young": YOUNG, "poisson": 0.0, "density": DENSITY},
        "geometrically_nonlinear": False,
        "supports": [{"group": "root"}, {"group": "all", "components": ["y"]}],
        "attachments": [{"group": "first", "to": {"group": "second"}, **spring}],
        "probe": {"group": "tip"},
    }
    loaded = "loads" in tables
    return fenicsrom.parse_scene(table | tables, "rods.toml", path, unloaded=not loaded)


def solid(scene: Any) -> Any:
    return solid_of(scene, build_mesh(scene.geometry, MPI.COMM_SELF), free=True)


def test_two_rods_with_a_spring_have_the_frequencies_of_the_closed_form(tmp_path: Path) -> None:
    """EA β cos βL₁ = k (cos βL₁ cot βL₂ − sin βL₁) of rods of lengths L₁, L₂, ω = β √(E/ρ).

    Reference: two rods with a spring between | closed form | 658.99 to 4470.9 Hz | agree | 1e-4
    """
    stiffness = 0.5 * YOUNG * AREA
    found = component_modes(solid(rods(tmp_path, {"stiffness": stiffness})), Basis(modes=3))

    def residual(beta: float) -> float:
        first, second = beta * np.array(LENGTHS)
        force = YOUNG * AREA * beta * np.cos(first) * np.sin(second)
        return float(force - stiffness * np.cos(first + second))

    grid = np.linspace(0.01, 12.0, 400)
    signs = np.sign([residual(beta) for beta in grid])
    roots = [brentq(residual, grid[k], grid[k + 1]) for k in np.flatnonzero(np.diff(signs))[:3]]
    exact = np.array(roots) * SPEED / (2.0 * np.pi)
    np.testing.assert_allclose(found.frequencies_hz, exact, rtol=1e-4)


def test_two_free_masses_with_a_spring_have_one_frequency(tmp_path: Path) -> None:
    """ω² = k (1/m₁ + 1/m₂); all other motions of the two stiff bodies are rigid.

    Reference: two free masses and a spring | closed form | 5.202 Hz | agrees | 1e-5
    """
    body = solid(rods(tmp_path, {"stiffness": 400.0}, supports=[]))
    mass = DENSITY * AREA * np.array(LENGTHS)
    assert body.rigid.shape[1] == 5
    omega = component_modes(body, Basis(modes=1)).omega[0]
    assert omega == pytest.approx(np.sqrt(400.0 * np.sum(1.0 / mass)), rel=1e-5)


DRIVE = {"group": "tip", "direction": [1.0, 0.0], "force": 3.0}


def oscillator(path: Path, **tables: Any) -> tuple[Any, float]:
    """A mass of the second rod on a spring and a dashpot with ζ = 0.2 at the first one, 10 Hz."""
    mass, omega = DENSITY * AREA * LENGTHS[1], 20.0 * np.pi
    spring = {"stiffness": mass * omega**2, "damping": 0.4 * mass * omega}
    return rods(path, spring, cells=2, **tables), mass


@pytest.mark.slow
def test_dashpot_damps_the_decay_as_in_the_closed_form(tmp_path: Path) -> None:
    """After a push the mass moves as e^(−ζωt) cos (√(1 − ζ²) ωt − φ), reduced and full.

    Reference: decay by a dashpot between bodies | closed form | ζ = 0.2 | agrees | 0.5 %
    """
    pushed = [{**DRIVE, "pulse": {"duration": 0.004}}]
    scene, _ = oscillator(tmp_path, loads=pushed, time={"step": 4e-4, "duration": 0.3})
    rate = 20.0 * np.pi * complex(-0.2, np.sqrt(1.0 - 0.2**2))
    for motion in (
        fenicsrom.build_model(scene).simulate(),
        simulate(full_model(solid(scene)), scene),
    ):
        late = motion.time > 0.02
        wave, x = np.exp(rate * motion.time[late]), motion.displacement[late, 0]
        columns = np.stack([wave.real, wave.imag], axis=1)
        fitted = columns @ np.linalg.lstsq(columns, x, rcond=None)[0]
        np.testing.assert_allclose(x, fitted, atol=5e-3 * np.abs(x).max())


@pytest.mark.slow
def test_response_of_a_mass_on_spring_and_dashpot_is_that_of_the_closed_form(
    tmp_path: Path,
) -> None:
    """|x| = F / |k − mω² + iωc|."""
    driven = {"loads": [{**DRIVE, "frequency": 9.0}], "time": {"steps_per_period": 200}}
    scene, mass = oscillator(tmp_path, response={"first": 8.0, "last": 12.0}, **driven)
    for point in fenicsrom.response(scene).curves[0].points:
        omega, own = 2.0 * np.pi * point.parameter, 20.0 * np.pi
        exact = 3.0 / mass / abs(own**2 - omega**2 + 0.4j * own * omega)
        assert point.amplitude.max() == pytest.approx(exact, rel=1e-3)


def test_marks_of_a_spring_stand_at_both_its_places(tmp_path: Path) -> None:
    scene = rods(tmp_path, {"stiffness": 1.0})
    found = gathered_marks(solid(scene), scene, {})
    assert found is not None
    (mark,) = [mark for mark in found[2] if mark.kind == "attachment"]
    np.testing.assert_allclose(mark.places[:, 0], [0.4, 0.5])


def test_spring_to_a_place_that_cannot_move_is_refused(tmp_path: Path) -> None:
    for to in ({"group": "root"}, {"box": [[0.39, -1.0], [0.41, 1.0]]}, {"node": [3.0, 0.0]}):
        key = "attachments[0].to.node" if "node" in to else "attachments[0].to"
        with refusal(ErrorKind.PLACE, key, file="rods.toml"):
            solid(rods(tmp_path, {"stiffness": 1.0, "to": to}))


def test_deck_with_a_spring_between_places_is_refused(tmp_path: Path) -> None:
    with refusal(ErrorKind.CONFLICT, "attachments[0].to"):
        scene_deck(rods(tmp_path, {"stiffness": 1.0}))
