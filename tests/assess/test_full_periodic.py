"""Periodic motions of the full model against its own time integration and against differences."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray
from support import beam_scene, enriched, heard, make_solid

pytest.importorskip("dolfinx")

from fenicsrom.assess.full.full_motions import (
    STALLED,
    FullPeriodicMotion,
    _Problem,
    full_periodic_motion,
    settled_full_motion,
)
from fenicsrom.errors import ConvergenceError
from fenicsrom.fem.full.full import FullModel
from fenicsrom.online.model.model import Problem
from fenicsrom.online.motion.measures import amplitude
from fenicsrom.online.periodic.shooting import PeriodicMotion, Shooting, periodic_motion
from fenicsrom.online.run.march import integrate
from fenicsrom.online.run.simulate import simulate
from fenicsrom.reduction.basis import project
from fenicsrom.scene import Scene

pytestmark = pytest.mark.slow

Array = NDArray[np.float64]
MOST = 12  # full periods that a motion may take


class Case(NamedTuple):
    """A solid, its reduced model and the reduced motion."""

    scene: Scene
    solid: Any
    basis: Array
    shooting: Shooting
    reduced: PeriodicMotion

    def find(self, **options: Any) -> FullPeriodicMotion:
        """The motion of the full model."""
        return full_periodic_motion(self.solid, self.basis, self.shooting, self.reduced, **options)


def case(scheme: str, dimension: int = 2, damping: float = 0.6, force: float = 60.0) -> Case:
    """A beam of few elements whose tip slips and lifts off, and its reduced motion."""
    radius = ("time.spectral_radius=0.8",) if scheme == "generalised-alpha" else ()
    scene = beam_scene(
        dimension,
        (
            f"geometry.parameters.elements_along={8 - 2 * dimension}",
            "geometry.parameters.load_at=0.5",
            f"material.mass_damping={damping}",
            f"loads.0.force={force}",
            "loads.0.frequency=2.5",
            "contacts.0.preload=0.8",
            "contacts.0.friction=0.1",
            "time.steps_per_period=40",
            "time.periods=30",
            f"time.scheme='{scheme}'",
            *radius,
        ),
    )
    solid = make_solid(scene)
    basis = enriched(solid)[2]
    model = project(solid, basis)
    problem = Problem.of(model, scene).settled()
    end = simulate(model, scene).end
    reduced = periodic_motion(problem, end, tolerance=1e-8)
    shooting = Shooting(problem)
    return Case(scene, solid, basis.vectors, shooting, reduced)


@pytest.fixture(scope="module")
def dissipative() -> Case:
    return case("generalised-alpha", damping=1.2)


@pytest.mark.long
@pytest.mark.slow
def test_motion_equals_a_long_march(dissipative: Case) -> None:
    found = dissipative.find()
    scene = dissipative.scene
    time = scene.time.changed(periods=900, steady_tolerance=1e-9)
    marched = simulate(FullModel(dissipative.solid), replace(scene, time=time))
    assert marched.steady and marched.periods > 80
    assert found.periods <= MOST
    exact = np.ptp(marched.displacement[marched.last_period()], axis=0) / 2.0
    np.testing.assert_allclose(found.amplitude, exact, atol=1e-6 * exact.max())
    assert set(np.unique(found.record.state)) >= {-1, 0}  # it lifts off and slips
    error = np.abs(dissipative.reduced.amplitude - exact).max()
    assert error > 1e-5 * exact.max()  # the reduced motion is another one


def test_march_that_does_not_settle_gives_way_to_the_periodic_motion(dissipative: Case) -> None:
    """The march of ten periods misses the amplitude of the periodic motion; a settled one stays."""
    solid, scene, basis = dissipative.solid, dissipative.scene, dissipative.basis
    model = dissipative.shooting.problem.model
    motion = simulate(model, scene)
    marched = simulate(FullModel(solid), replace(scene, time=scene.time.changed(periods=10)))
    found, said = settled_full_motion(solid, basis, model, scene, motion, marched)
    exact = dissipative.find().amplitude[0]
    size = exact.max()
    assert not marched.steady and found.steady and "Newton" in said
    assert np.abs(amplitude(marched) - exact).max() > 1e-2 * size
    np.testing.assert_allclose(amplitude(found), exact, atol=1e-5 * size)
    assert found.periods > marched.periods and found.seconds > marched.seconds
    assert settled_full_motion(solid, basis, model, scene, motion, found) == (found, "")
    unsettled = replace(motion, steady=False)
    assert settled_full_motion(solid, basis, model, scene, unsettled, marched) == (marched, "")


@pytest.mark.parametrize(
    ("scheme", "dimension"), [("discrete-gradient", 2), ("discrete-gradient", 3)]
)
def test_motion_without_numerical_damping_repeats(scheme: str, dimension: int) -> None:
    found_case = case(scheme, dimension)
    found = found_case.find()
    assert found.periods <= MOST and found.derived > 0
    n, d = found_case.solid.local, dimension
    shooting = found_case.shooting
    sliders = np.zeros(shooting.problem.contacts.preload.size * d)
    sliders[shooting.map.memory] = found.z[shooting.map.blocks * n :]
    again = integrate(
        shooting.problem._replace(
            model=FullModel(found_case.solid),
            time=found_case.scene.time.changed(periods=3, steady_tolerance=0.0),
        ),
        start=(found.z[:n], found.z[n : 2 * n], sliders.reshape(-1, d)),
    )
    steps = (again.time.size - 1) // 3
    size = found.amplitude.max()
    for k in range(3):
        span = again.displacement[k * steps : (k + 1) * steps + 1]
        np.testing.assert_allclose(np.ptp(span, axis=0) / 2.0, found.amplitude, atol=2e-6 * size)
    assert again.end is not None
    np.testing.assert_allclose(again.end.state.q, found.z[:n], atol=1e-5 * size)


@pytest.mark.parametrize(
    "scheme",
    [
        pytest.param("discrete-gradient", marks=[pytest.mark.slow]),
        pytest.param("average-acceleration", marks=[pytest.mark.slow, pytest.mark.long]),
        pytest.param("generalised-alpha", marks=[pytest.mark.slow, pytest.mark.long]),
    ],
)
def test_derivatives_along_directions_match_differences(scheme: str) -> None:
    """Along random sums of all directions."""
    found = case(scheme, damping=5.0, force=30.0)
    problem = _Problem(found.solid, found.basis, found.shooting)
    z = problem.expanded(found.shooting.scaled(found.reduced.z))
    block = problem.directions()
    end = problem.map(z, block)
    size = problem.norm(z)
    slips = end.record.state[-1] == 0  # the law has a kink there: the slider is at its limit
    count, rng = block.shape[1] - int(slips.any()), np.random.default_rng(0)
    for _ in range(4):
        weights = rng.standard_normal(count)
        weights /= np.linalg.norm(weights)  # the directions are orthonormal
        step = 1e-5 * size * block[:, :count] @ weights
        ahead, behind = problem.map(z + step).z, problem.map(z - step).z
        difference = (ahead - behind) / (2e-5 * size)
        error = problem.norm(end.columns[:, :count] @ weights - difference)
        assert error <= 2e-3 * max(problem.norm(difference), 0.1)


def test_motion_that_is_not_found_keeps_its_residuals(dissipative: Case) -> None:
    lines: list[str] = []
    with heard(lines.append), pytest.raises(ConvergenceError) as caught:
        dissipative.find(tolerance=0.0, most_periods=2)
    assert len(caught.value.partial) == len(lines) == 2
    assert all(0.0 < residual < 1.0 for residual in caught.value.partial)


def test_search_that_comes_no_nearer_ends_early(dissipative: Case) -> None:
    with pytest.raises(ConvergenceError) as caught:
        dissipative.find(tolerance=0.0, most_periods=40)
    residuals = caught.value.partial
    assert STALLED < len(residuals) < 40
    assert min(residuals[-STALLED:]) >= min(residuals[:-STALLED])
