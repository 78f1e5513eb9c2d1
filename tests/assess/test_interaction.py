"""Interaction maps against the exact solution of two modes that rub a casing of two lobes.

The two modes have unit mass, omega_i^2 = (2 pi (100, 410))^2 + (1.8, 2.5) Omega^2, and one contact
point at 300 m from the axis, so that curvature and the lobe's argument do not matter.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from support import beam_scene, refusal

from fenicsrom import study
from fenicsrom.assess.studies import interaction
from fenicsrom.assess.studies.interaction import InteractionMap, map_speeds
from fenicsrom.assess.studies.map_line import PERIOD, UNSETTLED, WEARING, Line, verdict_of_last
from fenicsrom.errors import ConvergenceError, ErrorKind
from fenicsrom.notes import PEAK_FORCE, NoteKind
from fenicsrom.online.contact.points import ContactPoints
from fenicsrom.online.model.model import reduced_model
from fenicsrom.online.model.polynomial import ElasticPolynomial
from fenicsrom.online.motion.measures import lobes_of
from fenicsrom.online.run.simulate import load_histories
from fenicsrom.online.step.speed_range import RangeErrors, RangeModel
from fenicsrom.online.store.archive import StoredModel
from fenicsrom.online.store.scene_changes import changed_scene
from fenicsrom.post.base.tables import rows_of
from fenicsrom.post.studies.interaction_report import figure, quantities
from fenicsrom.progress import asking
from fenicsrom.study.curves import LINES

Array = NDArray[np.float64]
SQUARES, STIFFENING = (2.0 * np.pi * np.array([100.0, 410.0])) ** 2, np.array([1.8, 2.5])
RADIAL, TANGENTIAL = np.array([0.5, 2.0]), np.array([3.0, -1.0])  # kg^-1/2
RADIUS = 300.0  # m
GAP, LOBE, SPRING, FRICTION, DAMPING = 2e-4, 2.5e-4, 1e6, 0.15, 6.0


def two_modes(
    *changes: str, damping: float = DAMPING, radial: Array = RADIAL, **contact: Any
) -> StoredModel:
    """The model for a range of speeds; `contact` gives other keys than a gap."""
    scene = beam_scene(
        2,
        (
            f"material.mass_damping={damping}",
            "rotation={speed_rpm=3000.0, speeds_rpm=[0.0, 9000.0]}",
            "time.steps_per_period=600",
            *changes,
        ),
        loads=[
            {
                "group": "load",
                "at": "centre",
                "direction": [0.0, 1.0],
                "force": 1e-9,
                "engine_order": 1,
            }
        ],
        contacts=[
            {
                "group": "tip",
                "at": "centre",
                "normal_stiffness": SPRING,
                "tangential_stiffness": SPRING,
                "friction": FRICTION,
                "surface": {"kind": "cylinder", "point": [0.0, 0.0], "waves": [[2, LOBE, np.pi]]},
                **(contact or {"gap": GAP}),
            }
        ],
    )
    elastic = ElasticPolynomial(np.zeros(2), np.diag(SQUARES), np.zeros((0, 0)), np.zeros((0, 0)))
    points = ContactPoints(
        np.zeros(1, dtype=np.int64), np.ones(1), np.array([[RADIUS, 0.0]]), np.eye(2)[None]
    )
    rows = np.array([radial, TANGENTIAL])
    model = reduced_model(
        mass=np.eye(2),
        damping=damping,
        elastic=elastic,
        loads=np.array([[1.0], [0.0]]),
        load_histories=load_histories(scene),
        points=points,
        contact_rows=rows,
        contact_offset=np.zeros(2),
        probe=rows,
        probe_offset=np.zeros(2),
    )
    whole = RangeModel(
        model,
        np.zeros(2),
        -np.diag(STIFFENING),
        coriolis=np.zeros((0, 0)),
        euler=np.zeros(2),
        inertia=np.ones(1),
        moments=np.zeros((1, 3)),
        speeds=np.pi / 30.0 * np.array([0.0, 9000.0]),
        equilibria=np.zeros((2, 2)),
        modes=2,
        masters=0,
        errors=RangeErrors(*np.zeros((4, 1))),
    )
    return StoredModel(model, scene, "rubin", (), 2, np.zeros(0), {}, whole=whole).at_speed()


def mapped(stored: StoredModel, speeds: str, *changes: str, **options: Any) -> InteractionMap:
    """The map of a model at some speeds."""
    table = (f"map.speeds_rpm={speeds}", "map.revolutions=300", "map.last=10", *changes)
    return study.interaction_map(stored.with_overrides(table), **options)


@pytest.mark.slow
def test_lines_match_the_exact_motions() -> None:
    """Half ranges, peak forces and contact fractions by events located to 1e-16 s.

    Reference: two modes rub a casing, five speeds: half range, peak force | exact motion | 3.404e-5
    to 9.430e-4 m; 12.16 to 331.3 N | 0.41 %; 0.8 % | 0.5 %; 1 %
    """
    found = mapped(two_modes(), "[1500, 4100, 4400, 5000, 7000]")
    exact = (
        (3.404186e-5, 12.16375, 0.152),
        (4.701505e-4, 29.91217, 0.274),
        (9.430262e-4, 331.30685, 0.404),
        (5.605279e-5, 80.15742, 0.199),
        (3.832306e-4, 190.78964, 0.313),
    )
    for line, (amplitude, force, contact) in zip(found.lines, exact, strict=True):
        assert line.amplitude == pytest.approx(amplitude, rel=5e-3)
        assert line.peak_force == pytest.approx(force, rel=1e-2)
        assert line.contact == pytest.approx(contact, abs=5e-3)
        assert (line.verdict, line.period) == ("period", 1)
        top = found.orders[np.argmax(line.amplitudes)]
        assert top % 2 == 0
    assert found.lines[0].by_step.max() / 3.404186e-5 < 5e-3
    assert not found.lines[0].coexists


@pytest.mark.slow
def test_onsets_match_the_crossings() -> None:
    """Of the free blade; closed, with the friction of a sliding casing, from the characteristic
    polynomial.

    Reference: engine orders meet two modes, free and in contact: speeds | closed form | 503.155 to
    6695.27 rpm; 5354.2, 8425.3 rpm | agree | 1e-5; 1e-3
    """
    found = mapped(two_modes(), "[500, 3000, 6000, 9000]", "map.revolutions=10", "map.orders=12")
    onsets = {(mode, order): speeds for mode, order, *speeds in found.onsets()}
    free = {
        (1, 12): 503.155,
        (1, 10): 605.474,
        (1, 8): 760.775,
        (1, 6): 1025.978,
        (1, 4): 1592.235,
        (1, 2): 4045.199,
        (2, 12): 2068.03,
        (2, 10): 2491.34,
        (2, 8): 3136.88,
        (2, 6): 4250.23,
        (2, 4): 6695.27,
    }
    for key, speed in free.items():
        assert onsets[key][0] == pytest.approx(speed, rel=1e-5)
    assert onsets[1, 2][1] == pytest.approx(5354.2, rel=1e-3)
    assert onsets[2, 4][1] == pytest.approx(8425.3, rel=1e-3)


@pytest.mark.long
@pytest.mark.slow
def test_permanent_contact_converges_to_the_linear_response() -> None:
    """With a preload the contact never opens; the errors are those of the step, of second order.

    Reference: two modes in permanent contact: amplitude at four speeds | linear response |
    1.6009e-4 to 6.1326e-4 m | 1e-3 (600 steps) | 1e-3
    """
    exact = np.array([1.91089063e-4, 3.21745144e-4, 6.13255397e-4, 1.60085298e-4])
    errors, forces = [], []
    for steps in (300, 600):
        stored = two_modes(f"time.steps_per_period={steps}", preload=2000.0)
        found = mapped(stored, "[3000, 4500, 5000, 6000]", "map.revolutions=500")
        assert {line.contact for line in found.lines} == {1.0}
        assert all(np.isnan(line.clearance) for line in found.lines)
        stiffness = SQUARES + STIFFENING * (5000.0 * np.pi / 30.0) ** 2
        pushed = np.sum(RADIAL * (RADIAL + FRICTION * TANGENTIAL) / stiffness)
        mean = 2000.0 / (1.0 + SPRING * pushed)
        forces.append((found.lines[2].peak_force - mean) / 364.011959 - 1.0)
        errors.append(found.amplitudes[:, found.orders == 2.0][:, 0] / exact - 1.0)
    assert np.abs(errors[1]).max() < 1e-3
    assert np.abs((4.0 * errors[1] - errors[0]) / 3.0).max() < 2e-4
    assert abs((4.0 * forces[1] - forces[0]) / 3.0) < 5e-4


@pytest.mark.long
@pytest.mark.slow
def test_map_that_goes_up_follows_the_motions_to_their_peaks() -> None:
    """Peaks of the exact motions, each from the state before, within 1 %.

    Reference: two modes rub, map that goes up: peaks | exact motion | 4.16e-3 m at 4650 rpm;
    1.287e-3 m at 7275 rpm | 4.156e-3, 1.300e-3 m | 1.5 %
    """
    stored = two_modes()
    for speeds, at, amplitude, force in (
        ("{first=4400, last=4700, number=13}", 4650.0, 4.16e-3, 2556.0),
        ("{first=7100, last=7325, number=10}", 7275.0, 1.287e-3, None),
    ):
        found = mapped(stored, speeds, "map.start='up'")
        line = max(found.lines, key=lambda line: line.amplitude)
        assert (line.speed_rpm, line.verdict) == (at, "period")
        assert line.amplitude == pytest.approx(amplitude, rel=0.015)  # 1 %, and that of the step
        assert force is None or line.peak_force == pytest.approx(force, rel=0.015)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("start", "at", "amplitude"), [("up", 7275.0, 1.287e-3), ("down", 7125.0, 5.816e-4)]
)
def test_branches_by_newtons_method_are_those_of_the_marches(
    start: str, at: float, amplitude: float
) -> None:
    """The same peaks, of motions of one period that end after a few revolutions."""
    speeds = "{first=7100, last=7325, number=10}"
    found = mapped(two_modes(), speeds, f"map.start='{start}'", "map.steady='newton'")
    line = max(found.lines, key=lambda line: line.amplitude)
    assert line.speed_rpm == at and line.amplitude == pytest.approx(amplitude, rel=0.015)
    assert {(line.verdict, line.period) for line in found.lines} == {("period", 1)}
    checked = {7100.0, at}  # the first speed, and the peak
    assert {one.speed_rpm for one in found.lines if one.by_basis.size} == checked
    last, marched = found.lines[-1], mapped(two_modes(), "[7325, 8999]").lines[0]
    np.testing.assert_allclose(last.amplitudes, marched.amplitudes, atol=2e-3 * last.amplitude)


@pytest.mark.slow
@pytest.mark.parametrize("steady", ["march", "newton"])
def test_checked_line_has_its_distance_from_finer_elements(steady: str) -> None:
    stored = two_modes()
    assert stored.whole is not None
    model = stored.whole.model
    softer = model.elastic._replace(stiffness=0.97 * model.elastic.stiffness)
    finer = replace(stored.whole, model=model._replace(elastic=softer))
    judged = replace(stored, whole=replace(stored.whole, finer=finer))
    line, exact = (
        mapped(one, "[1500, 1510]", "map.revolutions=20", f"map.steady='{steady}'").lines[0]
        for one in (judged, replace(stored, whole=finer).at_speed())
    )
    apart, size = np.abs(line.amplitudes - exact.amplitudes), line.amplitudes.max()
    assert apart.max() > 0.01 * size
    np.testing.assert_allclose(line.by_mesh, apart, rtol=0, atol=1e-4 * size)
    assert line.errors.max() >= line.by_mesh.max() / size


def test_speeds_that_did_not_settle_cast_doubt_on_the_map() -> None:
    """Nine of ten; the errors of the peak force of a checked speed concern this force alone."""
    checked = {"errors": np.zeros(3), "worn_errors": np.zeros(0), "coexists": False}
    lines = [
        SimpleNamespace(verdict=verdict, speed_rpm=100.0 * k, force_error=0.2, **checked)
        for k, verdict in enumerate([PERIOD, *[UNSETTLED] * 9])
    ]
    found: Any = SimpleNamespace(lines=lines, scene=beam_scene(2))
    unsettled, force = interaction._warnings(found)
    assert unsettled.startswith("9 of 10 speeds, 100 to 900 rpm: ")
    assert unsettled.kind is NoteKind.UNSETTLED and unsettled.quantity == ""
    assert force.startswith("10 of 10 checked speeds, 0 to 900 rpm")
    assert force.quantity == PEAK_FORCE
    lines[0].force_error = 0.0
    found.lines = lines[:1]
    assert interaction._warnings(found) == []


@pytest.mark.slow
def test_coexisting_motions_are_flagged() -> None:
    """At 3000 rpm there is a motion of period 1, 2.764831e-5 m; from rest another one is found."""
    found = mapped(two_modes(), "[3000, 8999]", "map.revolutions=500")
    line = found.lines[0]
    assert line.verdict == "torus" and line.amplitude > 4e-5
    assert line.coexists and line.other == pytest.approx(2.764831e-5, rel=0.01)
    assert any("3000 rpm: another start leads to another motion" in one for one in found.warnings)


@pytest.mark.slow
@pytest.mark.parametrize("first", [0.0, 1e-13, -1e-13])
def test_other_start_of_a_straight_blade_is_as_large_as_its_motion(first: float) -> None:
    """The first mode moves the tip along the casing, and away from it by rounding at most."""
    stored = two_modes(radial=np.array([first, 2.0]), damping=60.0)
    line = mapped(stored, "[6000, 8999]", "map.steady='newton'").lines[0]
    assert line.verdict == "period" and line.contact > 0.0
    assert line.other == pytest.approx(line.amplitude, rel=1e-3) and not line.coexists


def test_body_at_rest_is_steady_and_without_errors() -> None:
    """Nothing touches, and the load of 1e-9 N moves the tip by less than rounding of 300 m."""
    found = mapped(two_modes(gap=2.0), "[6000, 8999]", "map.revolutions=10")
    line = found.lines[0]
    assert (line.verdict, line.period) == ("period", 1)
    assert line.errors.max() < 1e-3 and not line.coexists
    check_bar(found, 2e-6, 5e-6)
    check_bar(found, 2e-6, 5e-4)


def check_bar(found: InteractionMap, *amplitudes: float) -> None:
    """The colour bar of the amplitudes in m at two speeds is marked in mm."""
    lines = [
        replace(line, amplitudes=np.full_like(line.amplitudes, one))
        for line, one in zip(found.lines, amplitudes, strict=True)
    ]
    shade: Any = figure(replace(found, lines=lines)).panels[0].items[0]
    low, high = np.log10(1e3 * np.array(amplitudes)) + np.array([-1e-12, 1e-12])
    for mark, text in shade.ticks.items():
        assert float(text) == pytest.approx(10.0**mark, rel=5e-3)
        assert low <= mark <= high
    assert len(shade.ticks) >= 2


@pytest.mark.long
@pytest.mark.slow
def test_motion_that_rings_on_is_the_periodic_one_to_which_it_tends() -> None:
    """A march of hardly damped modes changes from revolution to revolution, as a torus does."""
    stored, speeds = two_modes(damping=0.3), "[1500, 8999]"
    found = mapped(stored, speeds, "map.revolutions=60").lines[0]
    exact = mapped(stored, speeds, "map.steady='newton'").lines[0]
    assert (found.verdict, found.period) == (exact.verdict, exact.period) == ("period", 1)
    np.testing.assert_allclose(found.amplitudes, exact.amplitudes, atol=1e-6 * exact.amplitude)


def test_verdict_tells_periods_tori_and_other_motions() -> None:
    steps, last = 100, 20
    turns = np.arange(steps * last) / steps
    noise = np.random.default_rng(1).standard_normal(turns.size)

    def verdict(x: Array) -> tuple[str, int]:
        return verdict_of_last(x[:, None], steps, 1e-9)

    two = np.cos(4.0 * np.pi * turns)
    assert verdict(two) == ("period", 1)
    assert verdict(two + 0.1 * np.cos(np.pi * turns)) == ("period", 2)
    assert verdict(two + 0.3 * np.cos(2.0 * np.pi * np.sqrt(2.0) * turns)) == ("torus", 0)
    assert verdict(two + 0.3 * noise) == ("not periodic", 0)
    assert verdict(two * np.exp(-0.01 * turns)) == ("not settled", 0)
    assert verdict(1e-12 * noise) == ("period", 1)  # rounding of a body at rest
    decaying = np.exp(-0.05 * turns) * np.cos(2.0 * np.pi * np.sqrt(2.0) * turns)
    assert verdict(two + 0.1 * decaying) == ("not settled", 0)


@pytest.mark.slow
def test_stopped_map_continues(tmp_path: Path) -> None:
    """The speeds that are kept are not computed again; another scene does not take them."""
    stored = two_modes("output.pictures=false")
    few = ("map.revolutions=20",)

    def stop() -> bool:
        return len(list((tmp_path / LINES).glob("*.npz"))) == 2

    with asking(stop):
        part = mapped(stored, "[2000, 3000, 4000]", *few, folder=tmp_path)
    assert part.interrupted and len(part.lines) == 2
    whole = mapped(stored, "[2000, 3000, 4000]", *few, folder=tmp_path, resume=True)
    assert (whole.reused, len(whole.lines), whole.interrupted) == (2, 3, False)
    fresh = mapped(stored, "[2000, 3000, 4000]", *few)
    np.testing.assert_array_equal(whole.amplitudes, fresh.amplitudes)
    again = mapped(stored, "[2000, 3000, 4000]", *few, folder=tmp_path, resume=True)
    assert again.reused == 3 and list(again.column("seconds")) == list(whole.column("seconds"))
    other = mapped(stored, "[2000, 2100]", *few, "map.last=5", folder=tmp_path)
    assert other.reused == 0
    names = {path.name for path in tmp_path.iterdir()}
    assert {"map.csv", "map.json", "map.h5", "report.html"} <= names


def test_map_computes_a_speed_again_whose_file_is_damaged(tmp_path: Path) -> None:
    stored, few = two_modes("output.pictures=false"), ("map.revolutions=10",)
    whole = mapped(stored, "[2000, 2100]", *few, folder=tmp_path)
    file = max((tmp_path / LINES).glob("*.npz"), key=lambda file: file.stat().st_mtime_ns)
    file.write_bytes(file.read_bytes()[:-30])
    again = mapped(stored, "[2000, 2100]", *few, folder=tmp_path, resume=True)
    np.testing.assert_array_equal(again.amplitudes, whole.amplitudes)
    np.testing.assert_array_equal(again.lines[1].errors, whole.lines[1].errors)


@pytest.mark.parametrize(
    ("override", "key"),
    [
        ("rotation.history=[[0.0, 1000.0]]", "rotation.history"),
        ("loads.0={group='load', at='centre', direction=[0, 1], force=1, frequency=3}", "map"),
        ("contacts.0.surface.spin=3.0", "map"),
        ("time={tolerance=1e-3, periods=20}", "time.tolerance"),
    ],
)
def test_what_does_not_follow_the_speed_of_a_map_is_refused(override: str, key: str) -> None:
    scene = two_modes().scene
    changes = [override]
    if key == "rotation.history":
        changes += ["time={duration=0.1, step=1e-4}", "rotation.coriolis=true"]
    with refusal(ErrorKind.CONFLICT, key):
        map_speeds(changed_scene(scene, changes, scene.source))


LAYER = {
    "thickness": 5e-3,
    "modulus": 0.5e9,
    "yield_stress": 1e6,
    "hardening": 0.05e9,
    "area": 30e-6,
    "width": 1.0,
    "cells": 360,
}


def worn_map(speeds: str, steps: int, *changes: str, **options: Any) -> InteractionMap:
    """The map of a casing that wears; it closes in the first ten revolutions at 5500 rpm."""
    surface = {"kind": "cylinder", "point": [0.0, 0.0], "waves": [[2, 1.5e-4, np.pi]]}
    stored = two_modes(
        f"time.steps_per_period={steps}",
        gap=GAP,
        surface=surface,
        normal_stiffness=1e20,
        **({"approach": [[0.0, 0.0], [600.0 / 5500.0, 1e-4]], "abradable": LAYER} | options),
    )
    return mapped(stored, speeds, "map.revolutions=40", "map.last=40", *changes)


def worn_line(rpm: float, steps: int) -> tuple[dict[str, Any], Line]:
    """The wear and the line of one speed, at which the casing closes in ten revolutions."""
    found = worn_map(f"[{rpm}, 8999]", steps, approach=[[0.0, 0.0], [600.0 / rpm, 1e-4]])
    return rows_of(found.lines, quantities(found))[0], found.lines[0]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("rpm", "depth", "area", "peak", "within"),
    [(5500.0, 30.50e-6, 29.55e-6, 39.15, 5e-3), (7500.0, 99.2e-6, 158.6e-6, 59.76, 3e-2)],
)
def test_wear_of_a_map_matches_an_explicit_integration(
    rpm: float, depth: float, area: float, peak: float, within: float
) -> None:
    row, line = worn_line(rpm, 720)
    assert row["worn_depth_m"] == pytest.approx(depth, rel=within)
    assert row["worn_area_m_rad"] == pytest.approx(area, rel=within)
    assert line.peak_force == pytest.approx(peak, rel=within)
    assert row["worn_lobes"] == 2 and row["worn_depth_error"] < within
    assert line.verdict != WEARING and np.isnan(line.other)


@pytest.mark.slow
def test_wear_that_half_the_step_changes_is_marked() -> None:
    """At 3000 rpm, 360 steps per revolution give twice the depth of short steps, 4.1 um."""
    coarse, line = worn_line(3000.0, 360)
    assert coarse["worn_depth_error"] > 0.3
    assert line.worn_errors.shape == line.worn.shape == (360,)
    fine, _ = worn_line(3000.0, 1440)
    assert fine["worn_depth_m"] == pytest.approx(4.1e-6, rel=0.02)
    assert fine["worn_depth_error"] < 0.06


@pytest.mark.slow
def test_map_that_goes_up_continues_with_the_worn_layer() -> None:
    """Two runs of 12 revolutions at nearly one speed wear what one of 24 does; a map from rest has
    new layers at each speed."""
    whole = worn_map("[5500, 8999]", 360, "map.revolutions=24", "map.last=12").lines[0]
    some = ("map.revolutions=12", "map.last=12")
    half, rest = worn_map("[5500, 5500.0001]", 360, *some, "map.start='up'").lines
    assert half.worn.max() < 0.95 * whole.worn.max()
    np.testing.assert_allclose(rest.worn, whole.worn, rtol=0.0, atol=1e-4 * whole.worn.max())
    new = worn_map("[5500, 5500.0001]", 360, *some).lines[1]
    np.testing.assert_allclose(new.worn, half.worn, rtol=0.0, atol=1e-4 * whole.worn.max())


def test_map_that_goes_up_ends_where_a_layer_is_worn_through() -> None:
    thin = {**LAYER, "thickness": 2e-4, "modulus": 0.2e8, "hardening": 0.02e8}
    found = worn_map("[4250, 4300, 5500]", 360, "map.start='up'", abradable=thin)
    assert not found.lines and isinstance(found.unfinished, ConvergenceError)
    ends = "The map ends there: no other speed has a start."
    assert found.warnings[-1] == ends
    found = worn_map("[4250, 4300]", 360, abradable=thin)  # each speed starts from rest
    assert found.unfinished and ends not in found.warnings


def test_lobes_are_the_largest_harmonic_of_the_worn_depth() -> None:
    angle = 2.0 * np.pi / 90.0 * np.arange(90)
    depth = 1.0 + 0.2 * np.cos(3.0 * angle) + 0.5 * np.cos(7.0 * angle - 1.0)
    assert lobes_of(depth) == 7
    assert lobes_of(np.ones(90)) == lobes_of(np.zeros(90)) == 0
