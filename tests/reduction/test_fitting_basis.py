"""The basis fits the excitation: number of normal modes, responses to loads, snapshots."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from support import beam_scene

from fenicsrom.reduction.beam import BeamStructure, beam_structure
from fenicsrom.reduction.derivatives import modal_coordinates
from fenicsrom.reduction.load_responses import LOAD_SHARE
from fenicsrom.reduction.modes import (
    MOST_LINEAR_MODES,
    MOST_MODES,
    ComponentModes,
    component_modes,
    missing_modes,
    with_mode_count,
)
from fenicsrom.reduction.snapshots import (
    SNAPSHOTS,
    STATIC_LEVELS,
    Snapshots,
    curve_frequencies,
    snapshot_rows,
)
from fenicsrom.reduction.stages import Reduction
from fenicsrom.scene import Scene, make_scene, scene_table
from fenicsrom.scene.keys.excitation import highest_frequency

SECTION = {"length": 2.54, "height": 0.0254, "width": 0.0254, "elements": 20, "load_at": 0.7}
OPEN: dict[str, Any] = {"contacts": None, "probe": {"group": "tip"}}


def scene_with(*overrides: str, **tables: Any) -> Scene:
    reference = {"beam": True, "beam_section": SECTION}
    return beam_scene(2, overrides, reference=reference, **tables)


def modes_of(*overrides: str, **tables: Any) -> tuple[BeamStructure, ComponentModes]:
    scene = scene_with(*overrides, **tables)
    structure = beam_structure(scene)
    return structure, component_modes(structure, scene.basis)


# ---------------------------------------------------------------------- excitation


@pytest.mark.parametrize(
    ("overrides", "highest"),
    [
        ((), 3.2),
        (("loads.0.harmonics=[[1, 1.0, 0.0], [7, 0.1, 0.0], [9, 0.0, 0.0]]",), 22.4),
        (("loads.0.force=0",), 0.0),
        (("loads.0.sweep={to=40.0, duration=1.0}", "time={duration=1.0, step=1e-3}"), 40.0),
        (
            (
                "loads.0={group='load', direction=[0, 1], force=1, pulse={duration=0.01}}",
                "time={duration=1.0, step=1e-3}",
            ),
            100.0,
        ),
        (
            (
                "loads.0={group='load', direction=[0, 1], force=1, "
                "table=[[0, 0], [0.1, 1], [0.2, 0], [0.21, 0.05], [0.22, 0]]}",
                "time={duration=1.0, step=1e-4}",
            ),
            5.0,
        ),
        (("contacts.0.approach=[[0, 0], [0.1, 1e-3], [0.2, 0]]",), 5.0),
        (("response={first=3.0, last=8.0}",), 8.0),
        (("response={first=8.0, last=3.0}",), 8.0),
        (("response={first=1.0, last=2.0}",), 3.2),
    ],
)
def test_highest_frequency_is_that_of_the_fastest_excitation(
    overrides: tuple[str, ...], highest: float
) -> None:
    assert highest_frequency(beam_scene(2, overrides)) == pytest.approx(highest)


# ---------------------------------------------------------------------- number of modes


@pytest.mark.parametrize("method", ["rubin", "craig-bampton"])
@pytest.mark.parametrize("frequency", [30.0, 114.0])
def test_automatic_modes_reach_twice_the_frequency_of_the_loads(
    method: str, frequency: float
) -> None:
    scene = scene_with(f"basis.method='{method}'", f"loads.0.frequency={frequency}")
    structure = beam_structure(scene)
    many = component_modes(structure, replace(scene.basis, modes=12)).frequencies_hz
    wanted = max(3, int(np.sum(many <= 2.0 * frequency)) + 1)
    found = component_modes(structure, scene.basis)
    np.testing.assert_allclose(found.frequencies_hz, many[:wanted], rtol=1e-9)
    assert with_mode_count(scene, found).basis.modes == wanted


def test_automatic_modes_are_limited_with_a_warning() -> None:
    structure, found = modes_of("loads.0.frequency=1e6")
    assert found.omega.size == MOST_MODES
    (warning,) = structure.warnings
    assert str(MOST_MODES) in warning and "basis.modes" in warning
    linear, all_modes = modes_of("loads.0.frequency=1e6", "geometrically_nonlinear=false")
    assert all_modes.omega.size == linear.free // 2 < MOST_LINEAR_MODES


def test_modes_below_the_excitation_are_missed() -> None:
    scene = scene_with("loads.0.frequency=10")
    assert missing_modes(scene, np.array([3.0, 15.0])) is None
    assert missing_modes(scene_with("loads.0.force=0"), np.zeros(0)) is None
    for frequencies in (np.array([3.0, 14.9]), np.zeros(0)):
        sentence = missing_modes(scene, frequencies)
        assert sentence is not None and "basis.modes" in sentence


def test_automatic_modes_are_accepted_where_a_number_is() -> None:
    assert beam_scene(2).basis.modes == "auto"
    table = scene_table(beam_scene(2, ("basis.modes='auto'",)))
    assert make_scene(**table).basis.modes == "auto"


# ---------------------------------------------------------------------- responses to loads


def test_axial_load_adds_its_static_response() -> None:
    """No bending mode is moved by an axial load: the basis without its response leaves out all."""
    across, along = (modes_of(f"loads.0.direction={d}", **OPEN) for d in ([0, 1], [1, 0]))
    assert across[1].loads.labels == () and along[1].loads.labels == ("1L",)
    assert along[1].loads.shares["1L"] == pytest.approx(1.0, abs=1e-9)
    structure, modes = along
    load = structure.load_vectors[:, [0]]
    np.testing.assert_allclose(structure.stiffness @ modes.loads.vectors, load, atol=1e-6)


def test_oblique_load_adds_its_static_response() -> None:
    """The modes hold the work of the load, which is bending, and nothing of its axial part."""
    _, slightly = modes_of("loads.0.direction=[0.01, 1.0]", **OPEN)
    assert slightly.loads.labels == ()
    scene = scene_with("loads.0.direction=[0.3, 1.0]", "basis.derivatives='none'", **OPEN)
    structure = beam_structure(scene)
    basis = Reduction(structure, scene, lambda stage: nullcontext()).basis
    assert basis.labels == ("1V", "2V", "3V", "1L")
    r, load = basis.vectors, structure.load_vectors[:, 0]
    reduced = r @ np.linalg.solve(r.T @ structure.stiffness @ r, r.T @ load)
    exact = np.linalg.solve(structure.stiffness, load)
    axial, across = structure.probe_rows
    assert axial @ reduced == pytest.approx(axial @ exact, rel=1e-6)
    assert abs(axial @ exact) < 1e-3 * abs(across @ exact)


def test_linear_basis_always_holds_the_static_response() -> None:
    """The modes hold nearly all of a transverse load; a nonlinear basis accepts that."""
    linear = "geometrically_nonlinear=false"
    (structure, modes), (_, nonlinear) = modes_of(linear, **OPEN), modes_of(**OPEN)
    assert modes.loads.labels == ("1L",) and nonlinear.loads.labels == ()
    load = structure.load_vectors[:, [0]]
    np.testing.assert_allclose(structure.stiffness @ modes.loads.vectors, load, atol=1e-6)


def test_share_left_out_is_the_static_error_of_the_projection() -> None:
    structure, modes = modes_of("basis.modes=1", **OPEN)
    load = structure.load_vectors[:, 0]
    exact = load @ np.linalg.solve(structure.stiffness, load)
    mode = modes.normal[:, 0]
    kept = (load @ mode) ** 2 / (mode @ structure.stiffness @ mode)
    assert modes.loads.shares["1L"] == pytest.approx(1.0 - kept / exact, rel=1e-6)
    assert 1.0 - kept / exact < LOAD_SHARE and modes.loads.labels == ()


def test_equal_loads_add_one_response_and_static_loads_none() -> None:
    axial = {"group": "load", "direction": [1.0, 0.0], "force": 1.0}
    loads = [{**axial, "force": 0.0}, {**axial, "frequency": 3.2}, {**axial, "frequency": 6.4}]
    _, modes = modes_of(loads=loads, **OPEN)
    assert modes.loads.labels == ("2L",)
    assert set(modes.loads.shares) == {"2L", "3L"}
    assert modes.loads.shares["3L"] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("method", ["rubin", "craig-bampton"])
def test_basis_with_response_to_a_load_follows_it_statically(method: str) -> None:
    scene = scene_with(
        f"basis.method='{method}'", "basis.derivatives='none'", "loads.0.direction=[1, 0]", **OPEN
    )
    structure = beam_structure(scene)
    basis = Reduction(structure, scene, lambda stage: nullcontext()).basis
    assert basis.labels == ("1V", "2V", "3V", "1L")
    r, load = basis.vectors, structure.load_vectors[:, 0]
    reduced = r @ np.linalg.solve(r.T @ structure.stiffness @ r, r.T @ load)
    np.testing.assert_allclose(reduced, np.linalg.solve(structure.stiffness, load), atol=1e-15)


# ---------------------------------------------------------------------- snapshots


def test_snapshots_of_a_fast_load_beside_a_slow_one_see_both() -> None:
    """1000 steps in the slow period, and 100 fast periods: every fifth step is a zero of the fast
    motion."""
    time = np.arange(1000) / 1000.0
    coordinates = np.stack([np.sin(2 * np.pi * time), np.sin(200 * np.pi * time)], axis=1)
    assert np.abs(coordinates[::5, 1]).max() < 1e-9
    rows = snapshot_rows(coordinates, time, 100.0)
    assert rows.size <= SNAPSHOTS + 2 and np.all(np.diff(rows) > 0)
    found = coordinates[rows]
    np.testing.assert_allclose(np.abs(found).max(axis=0), np.abs(coordinates).max(axis=0))
    np.testing.assert_allclose(np.mean(found**2, axis=0), 0.5, rtol=0.1)


def test_snapshots_of_a_slow_load_are_at_equal_distances() -> None:
    time = np.linspace(0.0, 1.0, 501)
    assert snapshot_rows(np.zeros((501, 2)), time, 1.0).tolist() == list(range(0, 501, 3))
    assert snapshot_rows(np.zeros((200, 2)), time[:200], 1e3).tolist() == list(range(200))


@pytest.mark.parametrize("order", [1, 2])
def test_snapshots_of_a_response_curve_see_its_resonances(order: int) -> None:
    """The scene moves in the first mode; on its curve a load or harmonic meets the second mode."""
    harmonics = f"loads.0.harmonics=[[{order}, 1.0, 0.0]]"
    damped = "material.mass_damping=5.0"
    plain = scene_with(harmonics, damped, "time.steps_per_period=50", **OPEN)
    curve = make_scene(**scene_table(plain) | {"response": {"first": 5.0 / order, "last": 30.0}})
    structure = beam_structure(plain)
    modes = component_modes(structure, plain.basis)
    parts = []
    for scene in (plain, curve):
        found = Snapshots(structure, scene, modes)
        inner = structure.mass_inner
        linear = found.linear.vectors @ found.linear.coordinates
        q = modal_coordinates(modes.vectors, linear, inner, structure.largest(modes.vectors))
        parts.append(np.abs(q).max(axis=1) / np.abs(q).max())
        sizes = np.sqrt(np.diag(inner(linear, linear)))
        assert int(np.argmax(sizes > 0.999 * sizes.max())) < SNAPSHOTS
        assert found.static.shape == (structure.local, STATIC_LEVELS)
    assert parts[0][1] < 0.05 and parts[1][1] > 10.0 * parts[0][1]
    resonance = modes.frequencies_hz[1] / order
    assert resonance in curve_frequencies(structure, curve, modes)
    assert curve_frequencies(structure, plain, modes) == []
