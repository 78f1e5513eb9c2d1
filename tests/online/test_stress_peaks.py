"""The largest stresses of a motion and of modes, and the tables in an archive."""

from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from support import beam_scene, linear_model, refusal, uncoupled

from fenicsrom import study
from fenicsrom.errors import ErrorKind
from fenicsrom.files import read_archive
from fenicsrom.online.run.simulate import simulate
from fenicsrom.online.store.archive import FORMAT, StoredModel, load_model, save_model
from fenicsrom.online.stress.reactions import (
    ReactionTable,
    Recovery,
    find_stresses,
    modal_peaks,
    reduced_modes,
)
from fenicsrom.online.stress.stress import StressLaw, StressTable, von_mises
from fenicsrom.scene import Scene

Array = NDArray[np.float64]


def scene_with(*overrides: str) -> Scene:
    """A linear scene with stresses, of 40 steps per period."""
    short = ("time.periods=3", "time.steps_per_period=40", "time.steady='march'")
    linear = ("geometrically_nonlinear=false", "output.stresses='second-piola-kirchhoff'")
    return beam_scene(2, (*short, *linear, *overrides), contacts=None, probe={"group": "tip"})


def two_cells(scene: Scene, n: int = 2) -> Recovery:
    """The tables of two squares of four Gauss points that n random displacements strain."""
    rng = np.random.default_rng(1)
    cells = np.array([[0, 1, 3, 4], [1, 2, 4, 5]])
    corners = np.array([[0.0, 0], [1, 0], [2, 0], [0, 1], [1, 1], [2, 1]])
    g = 0.5 - 0.5 / np.sqrt(3.0)
    points = np.array([[g, g], [1 - g, g], [g, 1 - g], [1 - g, 1 - g]])
    x = np.array([[0.0, 0], [1, 0], [0, 1], [1, 1]])

    def bilinear(at: Array) -> Array:
        return np.column_stack([np.ones(4), at, at[:, 0] * at[:, 1]])

    stress = StressTable(
        StressLaw.of(scene),
        np.concatenate([points, points + np.array([1.0, 0.0])]),
        np.full(8, 0.25),
        1e-3 * rng.standard_normal((1 + n, 8, 2, 2)),
        cells,
        corners,
        rng.standard_normal((1 + n, 6, 2)),
        bilinear(x) @ np.linalg.inv(bilinear(points)),
    )
    reactions = ReactionTable(
        np.zeros((1, 2)),
        np.zeros(4, np.int64),
        1e-3 * rng.standard_normal((1 + n, 4, 2, 2)),
        rng.standard_normal((3, 4, 2, 2)),
        rng.standard_normal((2, 3, n)),
        np.zeros((2, 3, n)),
        np.zeros((2, 3, 1 + n)),
        rng.standard_normal((2, 3, 1)),
    )
    return Recovery(stress, reactions)


@pytest.fixture(scope="module")
def stored() -> StoredModel:
    """A linear model of two coordinates with stresses."""
    scene = scene_with("loads.0.force=111.0")
    model = uncoupled(scene, 500.0, 900.0)
    frequencies = np.sqrt([500.0, 900.0]) / (2.0 * np.pi)
    recovery = two_cells(scene)
    return StoredModel(model, scene, "rubin", ("1V", "2V"), 9, frequencies, {}, recovery)


def test_displacements_of_nodes_follow_the_coordinates(stored: StoredModel) -> None:
    assert stored.recovery is not None
    rest, first, second = stored.recovery.stress.vertex_displacement
    q = np.array([[0.0, 0.0], [2.0, 0.0], [1.0, -3.0]])
    found = stored.displacement(q)
    assert found.shape == (3, *stored.nodes.shape)
    np.testing.assert_allclose(found[0], rest, rtol=0, atol=1e-15)
    np.testing.assert_allclose(found[2], rest + first - 3.0 * second, rtol=0, atol=1e-14)
    np.testing.assert_array_equal(stored.displacement(q[1]), found[1])
    frequencies, shapes = stored.mode_shapes()  # of two oscillators that are not coupled
    np.testing.assert_allclose(frequencies, stored.frequencies_hz, rtol=1e-12)
    for shape, vector, mass in zip(
        shapes, (first, second), stored.model.mass.diagonal(), strict=True
    ):
        scale = np.sign(np.sum(shape * vector)) / np.sqrt(mass)
        np.testing.assert_allclose(shape, scale * vector, rtol=0, atol=1e-12)


def test_modes_of_basis_that_leaves_modes_out_keep_their_numbers() -> None:
    """The basis has modes 1 and 3 of the structure, and a static response near its mode 2."""
    scene = scene_with("loads.0.force=111.0")
    squares = np.array([500.0, 1700.0, 900.0, 1200.0])  # of 1V, 3V, 1A and 2A
    model = linear_model(np.eye(4), np.diag(squares))
    known = np.sqrt([500.0, 880.0, 1700.0]) / (2.0 * np.pi)
    found = StoredModel(model, scene, "rubin", ("1V", "3V", "1A", "2A"), 9, known, {})
    numbers, frequencies, vectors = reduced_modes(model, found.scene, found.normal_modes)
    assert numbers == [1, 3]
    np.testing.assert_allclose(frequencies, known[[0, 2]], rtol=1e-12)
    np.testing.assert_allclose(np.abs(vectors[:2]), np.eye(2), rtol=0, atol=1e-12)
    held = replace(found, method="craig-bampton")  # the frequencies of a held interface are others
    assert reduced_modes(model, held.scene, held.normal_modes)[0] == [1, 2, 3]


def test_displacements_of_nodes_need_stresses(stored: StoredModel) -> None:
    bare = replace(stored, tables=None, file="beam.npz")
    for compute in (lambda: bare.nodes, bare.mode_shapes, lambda: bare.displacement(np.zeros(2))):
        with refusal(ErrorKind.MISSING, "output.stresses", "beam.npz"):
            compute()


def test_largest_stress_of_motion_is_that_of_every_instant(stored: StoredModel) -> None:
    assert stored.recovery is not None
    scene = scene_with("loads.0.force=111.0")
    motion = simulate(stored.model, scene, keep_coordinates=True)
    found = find_stresses(stored.recovery, scene, stored.model, motion, stored.normal_modes)
    table, q, time = stored.recovery.stress, motion.coordinates, motion.coordinate_time
    assert q is not None and time is not None
    each = np.array([von_mises(table.at_vertices(table.stress(row))) for row in q])
    peaks = {peak.state: peak for peak in found.peaks}
    largest = peaks["largest of the last period"]
    row, vertex = np.unravel_index(np.argmax(each), each.shape)
    assert largest.von_mises == pytest.approx(each.max(), rel=1e-12)
    assert largest.time == time[row] and list(largest.position) == list(
        table.vertex_position[vertex]
    )
    assert found.largest is largest
    assert set(peaks) == {"equilibrium", "largest of the last period", "largest displacement"}
    farthest = peaks["largest displacement"]
    assert farthest.point_von_mises == pytest.approx(
        von_mises(table.stress(farthest.coordinates)).max()
    )
    assert found.motion_reactions is not None
    assert found.motion_reactions.values.shape == (time.size - 1, 1, 3)


def test_run_warns_of_a_state_that_is_turned_inside_out(
    stored: StoredModel, tmp_path: Path
) -> None:
    assert stored.recovery is not None
    short = ("time.periods=1", "geometrically_nonlinear=true", "output.pictures=false")
    scene = scene_with(*short, "loads.0.force=111.0")
    for gradient, warned in ((0.0, False), (-1.1, True)):
        gradients = 0.0 * stored.recovery.stress.gradients
        gradients[0, 3] = np.diag([gradient, 0.0])
        table = replace(stored.recovery.stress, law=StressLaw.of(scene), gradients=gradients)
        model = replace(stored, scene=scene, tables=replace(stored.recovery, stress=table))
        found = study.rerun(model, tmp_path)
        assert found.stresses is not None
        (smallest,) = {each.volume_ratio for each in found.stresses.deformations}
        assert (smallest <= 0.0) == warned
        said = [text for text in found.warnings if "inside out in equilibrium" in text]
        assert len(said) == warned and all("(0.7887, 0.7887)" in text for text in said)


def test_modal_stress_is_that_of_unit_displacement(stored: StoredModel) -> None:
    assert stored.recovery is not None
    _, frequencies, vectors = reduced_modes(stored.model, stored.scene, stored.normal_modes)
    np.testing.assert_allclose(frequencies, stored.frequencies_hz, rtol=1e-12)
    (first, second) = modal_peaks(stored.recovery.stress, frequencies, vectors, ["1V", "2V"])
    (same, _) = modal_peaks(stored.recovery.stress, frequencies, -7.0 * vectors, ["1V", "2V"])
    assert same.von_mises == pytest.approx(first.von_mises, rel=1e-12)
    assert first.frequency == frequencies[0] and second.von_mises != first.von_mises
    rest = stored.recovery.stress.displacement(np.zeros(2))
    moved = stored.recovery.stress.displacement(first.coordinates) - rest
    assert np.linalg.norm(moved, axis=1).max() == pytest.approx(1.0, rel=1e-12)


def test_tables_of_archive_are_read_back(stored: StoredModel, tmp_path: Path) -> None:
    path = tmp_path / "model.npz"
    save_model(path, stored)
    read = load_model(path).recovery
    assert read is not None and stored.recovery is not None
    for part in ("stress", "reactions"):
        table, other = getattr(stored.recovery, part), getattr(read, part)
        names = [entry.name for entry in fields(table) if entry.name not in ("law", "material")]
        assert len(names) == 7 + (part == "reactions")
        for name in names:
            np.testing.assert_array_equal(getattr(other, name), getattr(table, name))
    assert read.stress.law == stored.recovery.stress.law


def test_archive_without_stresses_has_no_tables(stored: StoredModel, tmp_path: Path) -> None:
    path = tmp_path / "model.npz"
    save_model(path, stored)
    with read_archive(path, "a model", FORMAT) as (_, arrays):
        assert {"tables.stress.gradients", "tables.reactions.static"} <= arrays.keys()
    save_model(path, replace(stored, tables=None))
    with read_archive(path, "a model", FORMAT) as (_, arrays):
        assert not any(name.startswith("tables") for name in arrays)
    assert load_model(path).recovery is None
