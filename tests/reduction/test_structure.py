"""The reduction of a structure that needs no dolfinx: the 1D beam."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from support import beam_scene, refusal

from fenicsrom.errors import ErrorKind
from fenicsrom.reduction import snapshots
from fenicsrom.reduction.beam import BeamStructure, beam_structure
from fenicsrom.reduction.modes import close_frequency_groups, component_modes
from fenicsrom.reduction.snapshots import (
    SNAPSHOT_PERIODS,
    Deflections,
    linear_model,
    linear_snapshots,
)
from fenicsrom.reduction.stages import Reduction, choose
from fenicsrom.scene import Scene


def scene_with(**basis: object) -> Scene:
    section = {"length": 1.0, "height": 0.05, "width": 0.0254, "elements": 10, "load_at": 0.5}
    scene = beam_scene(2, reference={"beam": True, "beam_section": section})
    return replace(scene, basis=replace(scene.basis, **basis))  # type: ignore[arg-type]


@pytest.fixture
def beam() -> BeamStructure:
    return beam_structure(scene_with())


@pytest.mark.parametrize("method", ["rubin", "craig-bampton"])
def test_enriched_basis_of_beam_keeps_contact_displacements(method: str) -> None:
    scene = scene_with(method=method, modes=2, derivatives="all", elastic_force="projection")
    beam = beam_structure(scene)
    basis = Reduction(beam, scene, lambda stage: nullcontext()).basis
    identity = np.eye(2, basis.size)
    np.testing.assert_allclose(beam.contact_rows @ basis.vectors, identity, atol=1e-9)


def test_polynomial_of_beam_is_refused_with_its_key() -> None:
    scene = scene_with(modes=1, derivatives="none", elastic_force="polynomial")
    reduction = Reduction(beam_structure(scene), scene, lambda stage: nullcontext())
    with refusal(ErrorKind.CONFLICT, "basis.elastic_force"):
        _ = reduction.model


def test_close_frequencies_form_one_group() -> None:
    omega = np.array([1.0, 1.004, 2.0, 3.0, 3.001, 3.002])
    groups = close_frequency_groups(omega, 5e-3)
    assert groups == [slice(0, 2), slice(2, 3), slice(3, 6)]
    assert close_frequency_groups(np.zeros(0), 5e-3) == []


def test_snapshots_do_not_depend_on_the_end_of_the_run() -> None:
    """A run that continues with more periods has the same basis."""
    found = []
    for end in ({"periods": 2}, {"periods": 30}, {"periods": 2, "steady_tolerance": 1e-2}):
        scene = scene_with(modes=2, elastic_force="projection")
        scene = replace(scene, time=scene.time.changed(steps_per_period=40, **end))
        beam = beam_structure(scene)
        model = linear_model(beam, component_modes(beam, scene.basis))
        found.append(linear_snapshots(beam, scene, model))
    for other in found[1:]:
        np.testing.assert_array_equal(other, found[0])


def test_transient_in_pieces_is_bitwise_that_of_one_march(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = scene_with(modes=2, elastic_force="projection")
    scene = replace(scene, time=scene.time.changed(steps_per_period=40))
    beam = beam_structure(scene)
    model = linear_model(beam, component_modes(beam, scene.basis))
    found, spans, march = [], [], snapshots.integrate

    def counted(*arguments: Any, **options: Any) -> Any:
        motion = march(*arguments, **options)
        spans.append(round(np.ptp(motion.time) / scene.period))
        return motion

    monkeypatch.setattr(snapshots, "integrate", counted)
    for piece in (1, 3, SNAPSHOT_PERIODS):
        monkeypatch.setattr(snapshots, "PIECE", piece)
        found.append(linear_snapshots(beam, scene, model))
    whole = spans.pop()
    assert whole > 6 and max(spans) == 4  # three periods and the one before
    for other in found[:-1]:
        np.testing.assert_array_equal(other, found[-1])


def test_nonlinear_statics_select_derivatives_in_mmi_nls_only() -> None:
    """The linear transient moves in the first mode only, the statics in the second."""
    scene = scene_with(modes=2, elastic_force="projection")
    beam = beam_structure(scene)
    modes = component_modes(beam, scene.basis)
    first, second = modes.normal[:, [0]], modes.normal[:, [1]]
    snapshots: Any = SimpleNamespace(linear=Deflections(first, np.eye(1)), static=0.5 * second)
    chosen = {}
    for method in ("mmi", "mmi-nls"):
        options = replace(scene.basis, derivatives=method, threshold=0.01)
        chosen[method] = choose(beam, replace(scene, basis=options), modes, snapshots)
    assert "2V2V" not in chosen["mmi"].derivatives
    assert "2V2V" in chosen["mmi-nls"].derivatives
