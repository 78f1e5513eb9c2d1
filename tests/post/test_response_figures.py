"""Figures and tables of response curves that are known in closed form."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from motions import curve_point
from support import beam_scene, contact_points, unexplained
from test_figures import illegible

from fenicsrom.assess.curves.results import Response, ResponseCurve
from fenicsrom.online.curves.curve import HARMONICS, PHASES, CurvePoint, Piece
from fenicsrom.post.base.drawing import figure_of
from fenicsrom.post.base.plot import Map
from fenicsrom.post.curves.response_figures import figure, phases, stretches
from fenicsrom.post.curves.response_report import (
    contact_map,
    folds_back,
    harmonics_figure,
    map_panel,
    multiplier_figure,
)
from fenicsrom.post.curves.response_tables import event_table, result_table, rows, sentences

DAMPING, CUBIC, FORCE = 0.05, 0.1, 0.1


def point(
    amplitude: float, lag: float, parameter: float, size: float, kind: str = ""
) -> CurvePoint:
    """A motion of one contact point; the states turn from stick to slip and open as it grows."""
    states = np.ones((PHASES, 1), np.int8)
    states[: int(PHASES * min(amplitude / 4.0, 1.0))] = 0
    states[: int(PHASES * min(amplitude / 8.0, 1.0))] = -1
    main = amplitude * np.exp(-1j * lag) * 10.0 ** -np.arange(HARMONICS)
    return curve_point(
        parameter,
        z=np.array([amplitude, parameter]),
        s=np.array([amplitude, parameter]),
        tangent=np.ones(3),
        amplitude=np.array([[0.01, amplitude]]),
        peak_force=np.array([amplitude]),
        friction_dissipation=2.0 * amplitude,
        multipliers=np.array([size, 0.5j, -0.5j, 0.1]).astype(complex),
        verdict="stable" if size <= 1.0 else "fold",
        kind=kind,
        harmonics=np.stack([0.01 * main, main], axis=1)[:, None, :],
        period_states=states,
        damping_dissipation=amplitude,
    )


def duffing(force: float) -> ResponseCurve:
    """The first harmonic of a Duffing oscillator, through its two folds if it has them."""
    peak = force / DAMPING
    grid = np.linspace(1e-3, peak, 4000)
    k = 1.0 + 0.75 * CUBIC * grid**2
    inside = 0.25 * DAMPING**4 - k * DAMPING**2 + (force / grid) ** 2
    grid, k, inside = (values[inside > 0.0] for values in (grid, k, inside))
    lower = np.sqrt(np.maximum(k - 0.5 * DAMPING**2 - np.sqrt(inside), 0.0))
    upper = np.sqrt(k - 0.5 * DAMPING**2 + np.sqrt(inside))
    amplitudes = np.concatenate([grid, grid[::-1]])
    omegas = np.concatenate([lower, upper[::-1]])
    kept = (omegas > 0.5) & (omegas < 1.8)
    amplitudes, omegas = amplitudes[kept][::8], omegas[kept][::8]
    stiff = 1.0 + 0.75 * CUBIC * amplitudes**2
    lags = np.arctan2(DAMPING * omegas, stiff - omegas**2)
    back = np.gradient(omegas) < 0.0
    piece = Piece(reason="end of the range")
    for k_, (a, lag, omega) in enumerate(zip(amplitudes, lags, omegas, strict=True)):
        piece.points.append(point(a, lag, omega, 3.0 if back[k_] else 0.9))
    turns = np.flatnonzero(np.diff(back.astype(int)) != 0)
    piece.special = [
        point(amplitudes[k], lags[k], omegas[k], 1.0, "fold") for k in (turns + 1).tolist()
    ]
    return ResponseCurve(force, [piece], [], (100, 50), 2.0)


def response_of(*forces: float) -> Response:
    """Curves over the frequency for some forces."""
    contact = {"group": "tip", "normal": [1.0, 0.0], "preload": 1.0, "normal_stiffness": 1.0}
    contact |= {"tangential_stiffness": 1.0, "friction": 0.3}
    table = {"parameter": "frequency", "first": 0.5, "last": 1.8}
    families = {"families": {"key": "loads.0.force", "values": list(forces)}}
    scene = beam_scene(2, contacts=[contact], response=table | (families if forces[1:] else {}))
    curves = [duffing(force) for force in forces]
    return Response(scene, 2, contact_points([1.0, 0.0]), curves)


@pytest.fixture(scope="module")
def found() -> Response:
    return response_of(0.02, 0.1, 0.2)


def test_columns_of_response_csv_are_explained() -> None:
    (columns, *_) = rows(response_of(0.1))
    assert len(columns) > 20 and unexplained([*columns, "other"], "response.csv") == ["other"]


def test_contact_points_of_events_count_from_one_as_in_the_pictures() -> None:
    found = response_of(0.1)
    (piece,) = found.curves[0].pieces
    piece.special = [replace(piece.points[3], kind="first slip", contact=0)]
    assert [row[0] for row in event_table(found)[1:]] == ["first slip, contact point 1"]
    assert {row["contact_point"] for row in rows(found)} == {None, 1}


DRAWINGS = (figure, contact_map, multiplier_figure, harmonics_figure)


@pytest.mark.slow
@pytest.mark.parametrize("draw", DRAWINGS)
@pytest.mark.parametrize("forces", [(0.1,), tuple(np.linspace(0.02, 0.2, 7))])
def test_figures_of_one_and_several_curves_are_legible(
    draw: Any, forces: tuple[float, ...], tmp_path: Any
) -> None:
    found = response_of(*forces)
    figure_of(draw(response_of(0.1)))  # the first figure of a process loads fonts
    drawn = figure_of(draw(found))
    drawn.savefig(tmp_path / "figure.png")
    assert not illegible(drawn)


def test_amplitude_is_dashed_between_the_folds_and_the_folds_are_marked(found: Response) -> None:
    axis = figure_of(figure(found)).axes[0]
    lines = [line for line in axis.lines if line.get_marker() == "None"]
    marks = [line for line in axis.lines if line.get_marker() == "o"]
    curve = found.curves[2]
    colour = lines[-1].get_color()
    mine = [line for line in lines if line.get_color() == colour]
    assert [line.is_dashed() for line in mine] == [False, True, False]
    np.testing.assert_array_equal(
        np.ravel([line.get_xdata() for line in marks if line.get_color() == colour]),
        [point.parameter for point in curve.special],
    )
    top = max(point.amplitude.max() for point in curve.points)
    assert max(float(np.max(line.get_ydata())) for line in mine) == pytest.approx(1e3 * top)


def test_phase_falls_from_zero_to_minus_180_through_minus_90_at_the_peak(found: Response) -> None:
    for curve in found.curves:
        points = curve.pieces[0].points
        phase = phases(points, 0, 1)
        assert np.all(np.diff(phase) < 0.0)
        assert -10.0 < phase[0] < 0.0 and -180.0 < phase[-1] < -170.0
        top = int(np.argmax([point.amplitude.max() for point in points]))
        assert phase[top] == pytest.approx(-90.0, abs=5.0)


def test_phase_is_continuous_where_its_angle_jumps() -> None:
    points = [point(1.0, lag, 1.0, 0.9) for lag in np.linspace(0.9 * np.pi, 1.3 * np.pi, 30)]
    phase = phases(points, 0, 1)
    assert np.abs(np.diff(phase)).max() < 5.0 and np.ptp(phase) == pytest.approx(72.0)
    assert phase[0] == pytest.approx(-162.0)  # the points lag behind


@pytest.mark.parametrize(("lag", "start"), [(180.5, 179.5), (175.0, -175.0)])
def test_phase_starts_between_minus_180_and_180(lag: float, start: float) -> None:
    """Below its resonance a body on a shaker moves against the acceleration."""
    points = [point(1.0, np.radians(lag + more), 1.0, 0.9) for more in (0.0, 90.0, 180.0)]
    np.testing.assert_allclose(phases(points, 0, 1), [start, start - 90.0, start - 180.0])


def test_contact_map_over_the_parameter_shows_the_states_of_the_nearest_motion() -> None:
    curve = duffing(0.02)
    assert not folds_back(curve)
    panel = map_panel(curve, 0, folded=False)
    points = curve.pieces[0].points
    places = np.array([point.parameter for point in points])
    (item,) = panel.items
    assert isinstance(item, Map) and panel.xlim == (places[0], places[-1])
    shown = np.array([point.period_states[:, 0] for point in points]).T
    np.testing.assert_array_equal(item.values, shown)
    np.testing.assert_array_equal(item.x, places)


def test_rows_have_units_phase_and_both_dissipations(found: Response) -> None:
    listed = rows(found)
    total = sum(len(curve.points) + len(curve.special) for curve in found.curves)
    assert len(listed) == total
    first, point_ = listed[0], found.curves[0].points[0]
    assert first["loads.0.force_N"] == 0.02
    assert first["frequency_Hz"] == point_.parameter
    assert first["amplitude_tangential_m"] == point_.amplitude[0, 1]
    assert first["harmonic_2_m"] == pytest.approx(0.1 * point_.amplitude[0, 1])
    assert first["phase_deg"] == pytest.approx(phases([point_], 0, 1)[0])
    assert first["friction_dissipation_per_period_J"] == 2.0 * point_.amplitude[0, 1]
    assert first["damping_dissipation_per_period_J"] == point_.amplitude[0, 1]


def test_stretches_share_a_bifurcation() -> None:
    points = [point(1.0, 0.1, p, size) for p, size in ((1.0, 0.9), (2.0, 0.9), (2.1, 3.0))]
    points.insert(2, point(1.0, 0.1, 2.05, 1.0, "fold"))
    assert stretches(points) == [(True, [0, 1, 2]), (False, [2, 3])]


def test_largest_amplitude_of_an_incomplete_curve_is_the_one_so_far() -> None:
    found = response_of(0.1)
    assert "so far" not in f"{sentences(found)}{result_table(found)}"
    found.curves[0].pieces[0].reason = "number of points"
    assert "amplitude so far" in sentences(found)[0]
    assert result_table(found)[1][0].endswith(" so far")
