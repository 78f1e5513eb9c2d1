"""The stability matrix of the demo beam: its quick part, and cases of the beam's geometry."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import stability_matrix
from stability_matrix import AXES, SCENE

from fenicsrom.assess.studies import stability
from fenicsrom.assess.studies.stability import Case, Finding, Verdict

CONVERGED, REFUSED = Verdict.CONVERGED, Verdict.REFUSED


def examine(case: Case) -> Finding:
    pytest.importorskip("dolfinx")
    table, scene = stability.load(SCENE)
    return stability.examine(case, table, scene.source, SCENE.parent)


MEASURED = [
    ("the scene", "slip and lift-off", CONVERGED),
    ("the scene", "high load", CONVERGED),
    ("the scene", "500 N, 20 N", CONVERGED),
    ("contact stiffness", "100000 N/m", CONVERGED),
    ("friction", "10", CONVERGED),
    ("preload", "0 N", CONVERGED),
    ("preload beyond buckling", "5400 N, no friction", CONVERGED),
    ("preload through buckling", "0.99 times the buckling load", CONVERGED),
    ("preload through buckling", "1.01 times the buckling load", CONVERGED),
    ("curved surface", "casing of 2.54 m", CONVERGED),
    ("speed", "600 rpm", CONVERGED),
    ("load", "2 times", CONVERGED),
    ("damping", "41.2 1/s", CONVERGED),
    ("steps per period", "100", CONVERGED),
    ("Poisson's ratio", "0.499, plane stress", CONVERGED),
    ("Young's modulus", "1000 Pa", REFUSED),
    ("contact direction", "at the clamp", REFUSED),
    ("too few derivatives", "none", REFUSED),
    ("scheme", "average-acceleration, 20 steps, slip and lift-off", REFUSED),
    ("impact", "gap 20 mm, 1e+06 N/m", REFUSED),  # periodic with these steps, not with half of them
]


SLOW = {
    "high load",
    "500 N, 20 N",
    "10",
    "5400 N, no friction",
    "1000 Pa",
    "average-acceleration, 20 steps, slip and lift-off",
    "gap 20 mm, 1e+06 N/m",
}


@pytest.mark.parametrize(
    ("axis", "value", "verdict"),
    [pytest.param(*case, marks=pytest.mark.slow if case[1] in SLOW else ()) for case in MEASURED],
)
def test_verdict_of_the_matrix_is_as_measured(axis: str, value: str, verdict: str) -> None:
    found = examine(Case(axis, value, AXES[axis][value]))
    assert found.verdict == verdict, found.why
    if verdict == REFUSED:
        assert found.why.split(":")[0] in ("SceneError", "ConvergenceError", "AccuracyError")
    else:
        assert (
            found.estimate is not None and found.error is not None and found.imbalance is not None
        )
        assert found.error <= max(stability.NEGLIGIBLE, found.estimate) and found.imbalance < 1e-9


def test_other_units_give_the_same_amplitude() -> None:
    found = examine(
        Case("units", "mm, t, s", stability_matrix.in_units(1e-3, 1e3, 1.0), scale=1e-3)
    )
    assert found.verdict == CONVERGED, found.why
    wrong = replace(found.case, scale=2e-3)
    assert examine(wrong).verdict is Verdict.WRONG


@pytest.mark.slow
def test_full_model_converges_where_average_acceleration_fails() -> None:
    """500 N, 20 N, friction 0.2 at 3.25 Hz by the default settings; average acceleration fails at
    200 steps a period."""
    found = examine(Case("the scene", "500 N, 20 N", stability_matrix.CRITICAL, "full"))
    assert found.verdict == CONVERGED and found.error is not None and found.error < 1e-3, found.why


WALL = stability_matrix.WALL


@pytest.mark.slow
def test_peak_force_estimate_of_a_resolved_impact_covers_the_error() -> None:
    soft = examine(
        Case("impact", "soft", (*WALL, "contacts.0.gap=0.1", "contacts.0.normal_stiffness=1e4"))
    )
    assert soft.force_error is not None and soft.force_estimate is not None
    assert 0.0 < soft.force_error < soft.force_estimate < 0.2


@pytest.mark.slow
def test_unresolved_impact_is_refused_and_its_peak_force_is_unknown() -> None:
    """Newton's method finds a stable motion of two periods of the load, with half and with twice
    the step too. Its amplitude has an estimate, which covers the error against 800 steps, 0.2 %.
    The peak force has none, and the basis is too small for the impact."""
    stiff = examine(
        Case("impact", "stiff", (*WALL, "contacts.0.gap=0.15", "contacts.0.normal_stiffness=1e8"))
    )
    assert stiff.force_estimate == np.inf
    assert stiff.estimate is not None and 2e-3 < stiff.estimate < 0.1
    assert stiff.verdict is REFUSED and "basis is too small" in stiff.why
    assert stiff.steady and stiff.periods is not None and stiff.periods < 100
    assert stiff.imbalance is not None and stiff.imbalance < 1e-9


@pytest.mark.slow
def test_estimate_covers_the_error_where_the_step_does_not_resolve_a_stiff_casing() -> None:
    """The peak force is unknown, so the estimate assumes first order; with half the step the motion
    of average acceleration loses its stability, and small waves persist."""
    casing = AXES["curved surface"]["casing of 2.54 m, 1e8 N/m"]
    found = examine(Case("casing", "", (*casing, "time.scheme='average-acceleration'")))
    assert found.force_estimate is not None and found.force_estimate > 1.0
    assert found.verdict == CONVERGED, found.why


@pytest.mark.slow
def test_wall_that_is_too_stiff_for_the_step_is_refused() -> None:
    """The motion of 200 steps is unstable; those of 400 and 800 steps are stable."""
    stiff = AXES["contact stiffness"]["1e+10 N/m"]
    found = examine(Case("wall", "", stiff))
    assert found.verdict == REFUSED and "try steps_per_period = 800" in found.why
    finer = examine(Case("wall", "", (*stiff, "time.steps_per_period=800")))
    assert finer.verdict == CONVERGED, finer.why


def distorted(folder: Path, shift: float) -> Finding:
    path = stability_matrix.zigzag_mesh(folder / "zigzag.msh", shift)
    geometry = f"geometry={{mesh={str(path)!r}, dimension=2, thickness=0.0254}}"
    return examine(Case("mesh", "", (geometry,)))


@pytest.mark.parametrize("shift", [0.2, 0.45])
def test_distorted_mesh_converges(tmp_path: Path, shift: float) -> None:
    found = distorted(tmp_path, shift)
    assert found.verdict is CONVERGED, found.why


def test_inverted_mesh_is_refused(tmp_path: Path) -> None:
    found = distorted(tmp_path, 0.6)
    assert found.verdict is REFUSED and "inverted" in found.why


def test_matrix_has_unique_cases_for_every_model(tmp_path: Path) -> None:
    wanted = list(stability_matrix.cases(tmp_path))
    assert sum(case.model == "reduced" for case in wanted) >= 100
    assert all(sum(case.model == model for case in wanted) >= 12 for model in ("full", "beam"))
    assert len({(case.axis, case.value, case.model) for case in wanted}) == len(wanted)
    named = {
        (axis, value) for axis, values in stability_matrix.RICHER_AXES.items() for value in values
    }
    assert named == {(case.axis, case.value) for case in wanted if case.richer}
    unsteady = {case.value for case in wanted if stability_matrix.is_unsteady(case)}
    assert unsteady == {value for values in stability_matrix.UNSTEADY.values() for value in values}
