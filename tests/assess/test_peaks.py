"""Peaks of response curves over a second number: the optimum of a friction damper."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from support import beam_scene, heard, linear_model

from fenicsrom.assess.curves.peaks import largest_peaks
from fenicsrom.assess.curves.response import response
from fenicsrom.assess.curves.results import Response
from fenicsrom.online.run.simulate import load_histories
from fenicsrom.online.store.archive import StoredModel
from fenicsrom.post.reports import report

pytestmark = pytest.mark.slow

FORCE, DAMPING, SPRING, FRICTION = 1.0, 0.04, 0.5, 0.5
LOW, HIGH = 0.85 / (2.0 * np.pi), 1.4 / (2.0 * np.pi)


def damper(*overrides: str) -> StoredModel:
    """x'' + damping x' + x + friction = force sin(omega t), along the second coordinate."""
    contact = {
        "nearest": [0.0, 0.0],
        "normal": [1.0, 0.0],
        "preload": 2.0,
        "normal_stiffness": 10.0,
        "tangential_stiffness": SPRING,
        "friction": FRICTION,
    }
    scene = beam_scene(
        2,
        (
            f"loads.0.force={FORCE}",
            f"loads.0.frequency={LOW}",
            f"material.mass_damping={DAMPING}",
            "time.steps_per_period=200",
            f"response.first={LOW}",
            f"response.last={HIGH}",
            'response.peak_over="contacts.0.preload"',
            "response.peak_range=[0.5, 12.0]",
            *overrides,
        ),
        contacts=[contact],
        probe={"group": "tip"},
        geometrically_nonlinear=False,
    )
    model = linear_model(
        np.eye(2),
        np.diag([1e4, 1.0]),
        damping=DAMPING,
        loads=[[0.0], [1.0]],
        load_histories=load_histories(scene),
        masters=2,
    )
    return StoredModel(model, scene, "rubin", ("1V", "2V"), 9, np.array([1.0, 10.0]), {})


def harmonic_peaks(preloads: NDArray[np.float64]) -> NDArray[np.float64]:
    """Peaks by the first harmonic of the slider's force (Griffin 1980)."""
    a = np.linspace(0.3, 30.0, 1500)[:, None]
    omega = np.linspace(0.85, 1.4, 300)
    found = []
    for preload in preloads:
        slip = FRICTION * preload / SPRING  # largest displacement without slip
        theta = np.arccos(1.0 - 2.0 * np.minimum(slip / a, 1.0))
        stiffness = SPRING / np.pi * (theta - 0.5 * np.sin(2.0 * theta))
        loss = 4.0 * FRICTION * preload * np.maximum(1.0 - slip / a, 0.0) / (np.pi * a)
        size = a * np.hypot(1.0 + stiffness - omega**2, DAMPING * omega + loss)
        found.append(float(a[size.min(axis=1) <= FORCE].max()))
    return np.array(found)


@pytest.fixture(scope="module")
def found() -> Response:
    return response(damper())


def test_peaks_and_optimum_of_a_damper_are_those_of_the_first_harmonic(found: Response) -> None:
    (curve,) = found.curves
    peaks = largest_peaks(curve.peaks)
    values = np.array([peak.value for peak in peaks])
    assert len(values) == 24 and (values[0], values[-1]) == pytest.approx((0.5, 12.0))
    own = [peak.amplitude for peak in peaks]
    np.testing.assert_allclose(own, harmonic_peaks(values), rtol=0.03)
    assert curve.optimum is not None and not found.warnings
    scan = np.geomspace(0.5, 12.0, 80)
    reference = harmonic_peaks(scan)
    assert curve.optimum.peak.amplitude == pytest.approx(reference.min(), rel=0.02)
    best = scan[reference <= 1.01 * reference.min()]
    assert best[0] < curve.optimum.peak.value < best[-1]
    low, high = curve.optimum.within
    assert low <= curve.optimum.peak.value <= high
    assert curve.optimum.step_error is not None and curve.optimum.step_error < 2e-3


def test_peaks_are_those_of_the_whole_curves(found: Response) -> None:
    peaks = largest_peaks(found.curves[0].peaks)[::8]
    values = ", ".join(f"{peak.value!r}" for peak in peaks)
    stored = damper()
    families = f'families={{key="contacts.0.preload", values=[{values}]}}'
    table = f"response={{first={LOW}, last={HIGH}, {families}}}"
    whole = response(stored.with_overrides([table]))
    for peak, curve in zip(peaks, whole.curves, strict=True):
        top = max(float(point.probe_amplitude.max()) for point in curve.points)
        assert peak.amplitude == pytest.approx(top, rel=1e-4)


def test_resumed_peaks_are_the_uninterrupted_ones(found: Response, tmp_path: Path) -> None:
    count = 0

    def say(line: str) -> None:
        nonlocal count
        count += "contacts.0.preload =" in line
        if count == 6:
            raise KeyboardInterrupt

    with heard(say):
        stopped = response(damper(), state=tmp_path)
    assert stopped.interrupted
    page = report(stopped)
    assert page.verdict.text == "Incomplete: the computation was interrupted."
    count = len(largest_peaks(stopped.curves[0].peaks))
    assert any(f"are incomplete: {count} values so far" in line for line in page.sentences)
    again = response(damper(), resume=tmp_path)
    pairs = zip(*(largest_peaks(one.curves[0].peaks) for one in (again, found)), strict=True)
    for mine, its in pairs:
        assert (mine.value, mine.amplitude) == (its.value, its.amplitude)
