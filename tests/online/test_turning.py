"""Bodies that turn at a varying speed, against closed forms and motions in the fixed frame."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import fsolve
from support import assert_tangent, fixed_steps, harmonic, no_contacts, random_polynomial, slope

from fenicsrom.errors import AccuracyError
from fenicsrom.online.contact.points import no_points
from fenicsrom.online.contact.surfaces import angle_at, speed_at, speed_history, times_of_angles
from fenicsrom.online.model.loads import TURNS
from fenicsrom.online.model.model import Problem, ReducedModel, reduced_model
from fenicsrom.online.model.polynomial import ElasticPolynomial, elastic_force, elastic_polynomial
from fenicsrom.online.model.turning import Turning
from fenicsrom.online.motion.motion import Motion
from fenicsrom.online.run.march import integrate
from fenicsrom.scene import Time

Array = NDArray[np.float64]
CROSS = np.array([[0.0, -1.0], [1.0, 0.0]])
SCHEMES = ("discrete-gradient", "average-acceleration", "generalised-alpha")


def linear(*stiffness: float) -> ElasticPolynomial:
    """The force of uncoupled springs."""
    n = len(stiffness)
    return ElasticPolynomial(np.zeros(n), np.diag(stiffness), np.zeros((0, 0)), np.zeros((0, 0)))


def turning_model(
    elastic: ElasticPolynomial, turning: Turning, *, damping: float = 0.0, order: int = 0
) -> ReducedModel:
    """Coordinates of unit mass, and a load sin(order θ) on the first one."""
    n = elastic.force.size
    loads = harmonic(float(order > 0), float(order), 0.0)
    loads.sines[:, TURNS] = order > 0
    loads = loads._replace(history=turning.history)
    moments = np.zeros((1, 1 + n))
    return reduced_model(
        np.eye(n),
        damping,
        elastic,
        np.eye(n, 1),
        loads,
        no_points(2),
        np.zeros((0, n)),
        np.zeros(0),
        np.eye(2, n),
        np.zeros(2),
        np.zeros((n, n)),
        turning=turning._replace(moments=moments),
    )


def particle(history: Array, radius: float) -> Turning:
    """A particle of 1 kg at a distance from the axis, in a plane."""
    none = np.zeros((0, 0))
    return Turning(
        history,
        np.array([radius, 0.0]),
        np.eye(2),
        2.0 * CROSS,
        np.array([0.0, radius]),
        radius**2,
        none,
        np.zeros((0, 3)),
    )


def run(
    model: ReducedModel,
    steps: int,
    duration: float,
    q: Array,
    v: Array,
    scheme: str = "discrete-gradient",
) -> Motion:
    """Integrate from a state."""
    problem = Problem(model, no_contacts(), fixed_steps(scheme, steps, duration), None)
    return integrate(problem, start=(q, v), keep_coordinates=True)


@pytest.mark.parametrize("scheme", SCHEMES)
def test_particle_on_spring_moves_straight_in_the_fixed_frame(scheme: str) -> None:
    """Test A: the closed form (cos 10 t, 0) of an isotropic spring, seen from a frame that speeds
    up.

    Reference: particle on a spring, Ω = 2 + 3t rad/s: place after 2 s | closed form in the fixed
    frame | (−0.34241004, 0.22200526) m | order 2 | 0.4 % of the errors
    """
    history = speed_history([[0.0, 2.0], [2.0, 8.0]])
    model = turning_model(linear(100.0, 100.0), particle(history, 0.0))
    exact = np.array([-0.34241004, 0.22200526]), np.array([9.43630573, -2.22733458])
    errors, counts = [], np.array([200, 400, 800, 1600])
    for steps in counts:
        found = run(model, int(steps), 2.0, np.array([1.0, 0.0]), np.array([0.0, -2.0]), scheme)
        errors.append(np.linalg.norm(found.coordinates[-1] - exact[0]))
    if scheme == "discrete-gradient":
        np.testing.assert_allclose(errors, [3.01e-2, 7.56e-3, 1.89e-3, 4.73e-4], rtol=4e-3)
        np.testing.assert_allclose(found.velocity[-1], exact[1], atol=1e-2)
        assert np.max(np.abs(found.imbalance)) < 1e-12 * np.max(found.kinetic)
    assert slope(1.0 / counts, errors) == pytest.approx(2.0, abs=0.1)


def test_particle_without_the_euler_force_is_refused_and_misses_the_closed_form() -> None:
    """Test A with springs that cancel the Euler force 3 E q: the ledger misses its work."""
    history = speed_history([[0.0, 2.0], [2.0, 8.0]])
    springs = linear(100.0, 100.0)
    springs.stiffness[:] -= 3.0 * CROSS
    model = turning_model(springs, particle(history, 0.0))
    with pytest.raises(AccuracyError) as refused:
        run(model, 1600, 2.0, np.array([1.0, 0.0]), np.array([0.0, -2.0]))
    missed = refused.value.partial.coordinates[-1] - [-0.34241004, 0.22200526]
    assert np.linalg.norm(missed) == pytest.approx(0.2787, abs=5e-4)


def oscillator(history: Array, stiffening: float = 0.0) -> ReducedModel:
    """One coordinate under the engine order sin 2θ."""
    still = particle(history, 0.0)._replace(
        centrifugal=np.zeros(1),
        softening=np.array([[-stiffening]]),
        coriolis=np.zeros((1, 1)),
        euler=np.zeros(1),
    )
    spring, damping = (80.0**2, 0.8) if stiffening else (1e4, 1.0)
    return turning_model(linear(spring), still, damping=damping, order=2)


def test_engine_order_of_the_speed_times_the_time_has_its_peak_too_early() -> None:
    """Test B: sin 2Ωt with Ω = 40 + t is the engine order of a body that turns at 40 + 2t."""
    wrong = oscillator(speed_history([[0.0, 40.0], [20.0, 80.0]]))
    found = run(wrong, 160_000, 20.0, np.zeros(1), np.zeros(1))
    top = found.time[np.argmax(np.abs(found.displacement[:, 0, 0]))]
    assert 40.0 + top == pytest.approx(45.93, abs=5e-3)


def test_steady_resonance_at_a_constant_speed_has_the_closed_peak() -> None:
    """Test B: the largest amplitude, 1 / (c √(10⁴ - c²/4)) at 4Ω² = 10⁴ - c²/2.

    Reference: oscillator under an engine order: largest amplitude | closed form | 1.0000125e-2 m
    | 6e-5 below | 1e-4
    """
    held = oscillator(speed_history([[0.0, 0.5 * np.sqrt(1e4 - 0.5)]]))
    found = run(held, 120_000, 30.0, np.zeros(1), np.zeros(1))
    last = np.abs(found.displacement[-4000:, 0, 0])
    assert last.max() == pytest.approx(1.0000125e-2, rel=1e-4)


@pytest.mark.parametrize(
    ("first", "last", "duration", "stiffening", "peak", "at"),
    [
        (40.0, 60.0, 20.0, 0.0, 6.05809677e-3, 51.2357),
        (60.0, 40.0, 20.0, 0.0, 6.09846308e-3, 48.7734),
        pytest.param(40.0, 60.0, 200.0, 0.0, 9.19907e-3, 50.2705, marks=pytest.mark.slow),
        (40.0, 70.0, 30.0, 1.8, 7.25987320e-3, 55.5594),
        (70.0, 40.0, 30.0, 1.8, 7.41760213e-3, 52.3100),
    ],
)
def test_run_through_resonance_has_the_peak_of_the_angle(
    first: float, last: float, duration: float, stiffening: float, peak: float, at: float
) -> None:
    """Test B: an engine order sin 2θ. The stiffness is 10⁴, or 80² + 1.8 Ω².

    Reference: oscillator run through its resonance five times: largest displacement | another
    program | 6.05809677e-3 m at 51.2357 rad/s; … | 5e-4 | 1e-3; 0.05 rad/s
    """
    history = speed_history([[0.0, first], [duration, last]])
    model = oscillator(history, stiffening)
    errors = []
    for steps in (1000.0, 2000.0):
        found = run(model, int(steps * duration), duration, np.zeros(1), np.zeros(1))
        moved = np.abs(found.displacement[:, 0, 0])
        top = int(np.argmax(moved))
        errors.append(abs(moved[top] / peak - 1.0))
    assert errors[1] < 1e-3 and errors[1] < 0.5 * errors[0]
    if (first, duration, stiffening) == (40.0, 20.0, 0.0):
        assert found.displacement[-1, 0, 0] == pytest.approx(-1.50660e-4, abs=1e-3 * peak)
    assert speed_at(history, found.time[top]) == pytest.approx(at, abs=0.05)


def bar() -> ElasticPolynomial:
    """A St Venant-Kirchhoff bar of 0.5 m and EA = 10 kN in a plane, and its free end."""
    length, stiffness = 0.5, 1e4
    strains = np.array([0.0, 1.0 / length, 0.0, 1.0 / length**2, 0.0, 1.0 / length**2])
    return elastic_polynomial(stiffness * length * np.outer(strains, strains), 2)


def equilibrium_of_bar(omega: float) -> Array:
    """The elongation of the bar on a hub of 0.3 m, by another solver."""

    def balance(q: Array) -> Array:
        force, tangent = np.empty(2), np.empty((2, 2))
        elastic_force(bar(), q, force, tangent)
        return force - omega**2 * (np.array([0.8, 0.0]) + q)

    return np.asarray(fsolve(balance, np.zeros(2), xtol=1e-12))


def test_bar_on_hub_that_speeds_up_balances_energy_and_momentum() -> None:
    """Test C: against the motion integrated in the fixed frame by another program.

    Reference: bar on a hub that speeds up: place; work of the shaft | another program, fixed
    frame | (0.0217076646, −0.0799151227) m; 217.44048039 J | order 2 | 5 % of the errors; 1e-5
    """
    history = speed_history([[0.0, 10.0], [1.0, 30.0]])
    turning = particle(history, 0.8)
    squares = np.linspace(10.0, 30.0, 9) ** 2
    rest = []
    for square in squares:
        q = equilibrium_of_bar(float(np.sqrt(square)))
        force, tangent = np.empty(2), np.empty((2, 2))
        grown = 1.6 * q[0] + q @ q
        rest.append([square, elastic_force(bar(), q, force, tangent) - 0.5 * square * grown])
        rest[-1].append(-0.5 * grown)
    model = turning_model(bar(), turning._replace(rest=np.array(rest)))
    start = equilibrium_of_bar(10.0)
    assert start[0] == pytest.approx(3.9723968e-3, rel=1e-7)
    exact = np.array([0.0217076646, -0.0799151227]), np.array([-0.2485757, -2.5788776])
    errors, works, counts = [], [], np.array([500, 1000, 2000, 4000])
    for steps in counts:
        found = run(model, int(steps), 1.0, start, np.array([0.0, 0.5]))
        errors.append(np.max(np.abs(found.coordinates[-1] - exact[0])))
        assert np.max(np.abs(found.imbalance)) < 2e-12
        # the shaft turns the mass: its torque is dL/dt, and its work raises the energy
        momentum = found.turning[:, 0]
        omega = speed_at_times(history, found.time)
        works.append(np.sum(np.diff(momentum) * 0.5 * (omega[1:] + omega[:-1])))
    np.testing.assert_allclose(errors, [4.9e-4, 1.2e-4, 3.0e-5, 7.3e-6], rtol=0.05)
    assert momentum[0] == pytest.approx(6.86570235, rel=1e-8)
    assert momentum[-1] == pytest.approx(18.30874893, rel=1e-5)
    np.testing.assert_allclose(found.velocity[-1], exact[1], atol=1e-3)
    assert found.elastic[0] == pytest.approx(0.0, abs=1e-12)
    assert slope(1.0 / counts[2:], np.abs(np.array(works[2:]) - 217.44048039)) > 1.9
    assert works[-1] == pytest.approx(217.44048039, rel=1e-5)


def speed_at_times(history: Array, times: Array) -> Array:
    """The speeds (k,) at some times."""
    return np.array([speed_at(history, t) for t in times])


def random_turning(n: int, history: Array) -> tuple[ReducedModel, Turning]:
    """A random nonlinear model at a varying speed, with damping."""
    rng = np.random.default_rng(4)
    lower, skew, viscous = rng.standard_normal((3, n, n))
    turning = Turning(
        history,
        rng.standard_normal(n),
        0.1 * lower @ lower.T,
        skew - skew.T,
        rng.standard_normal(n),
        2.0,
        np.zeros((0, 0)),
        np.zeros((0, 3)),
    )
    model = turning_model(random_polynomial(n, seed=3), turning)
    model.velocity_matrix[:] = 0.1 * viscous @ viscous.T
    return model, turning


@pytest.mark.parametrize("begin", [0.0, 0.35, 2.0])
def test_mean_force_of_step_at_varying_speed_has_its_tangent(begin: float) -> None:
    n = 4
    model, turning = random_turning(n, speed_history([[0.0, 1.0], [0.5, 3.0], [1.0, 2.0]]))
    q0, dq = np.random.default_rng(5).standard_normal((2, n))
    model.set_interval(begin, begin + 0.1)
    start = model.elastic_at(q0)[0].copy()
    points, weights = np.array([0.2, 0.8]), np.array([0.3, 0.4])

    def force(x: Array) -> Array:
        return model.elastic_over_step(start, q0, x, 0.3, points, weights)[0].copy()

    def tangent(x: Array) -> Array:
        return model.elastic_over_step(start, q0, x, 0.3, points, weights)[1].matrix.copy()

    assert_tangent(force, tangent, dq)
    # the velocity forces have the Coriolis force of the weighted speed
    ends = [speed_at(turning.history, t) for t in (begin, begin + 0.1)]
    omega = ends[0] + (weights @ points) * (ends[1] - ends[0])
    wanted = (model.velocity_matrix + omega * turning.coriolis) @ dq
    np.testing.assert_allclose(model.velocity_times(dq), wanted, rtol=1e-13)
    # at both ends of a step the force at a state is the gradient of its energy
    model.set_interval(begin, begin)

    def energy(x: Array) -> Array:
        return np.array([model.elastic_at(x)[1]])

    assert_tangent(energy, lambda x: model.elastic_at(x)[0][None].copy(), q0)


@pytest.mark.parametrize("scheme", SCHEMES)
def test_compiled_march_at_varying_speed_equals_plain_one(scheme: str) -> None:
    model, _ = random_turning(3, speed_history([[0.0, 1.0], [0.45, 3.0], [1.0, 2.0]]))
    rng = np.random.default_rng(6)
    q, v = 0.3 * rng.standard_normal((2, 3))
    problem = Problem(model, no_contacts(), fixed_steps(scheme, 40, 1.5), None)
    fast, slow = (
        integrate(problem, start=(q, v), keep_coordinates=True, compiled=compiled)
        for compiled in (True, False)
    )
    np.testing.assert_allclose(fast.coordinates, slow.coordinates, rtol=0, atol=1e-12)
    np.testing.assert_allclose(fast.turning, slow.turning, rtol=0, atol=1e-11)
    assert np.min(np.abs(fast.time - 0.45)) < 1e-12  # a step lands on the corner
    if scheme == "discrete-gradient":
        assert np.max(np.abs(fast.imbalance)) < 1e-12


def test_steps_of_equal_angles_follow_the_speed() -> None:
    history = speed_history([[0.0, 2.0], [0.4, 5.0], [1.0, 5.0], [2.0, 1.0]])
    times = times_of_angles(history, 0.1, 2.5)
    angles = np.array([angle_at(history, t) for t in times])
    wanted = np.delete(np.arange(1, 79), [13, 43, 73])  # the corners are at 14, 44 and 74
    np.testing.assert_allclose(angles, 0.1 * wanted, rtol=1e-12)
    model, _ = random_turning(2, history)
    settings = Time.of(duration=2.5, steps_per_revolution=60)
    problem = Problem(model, no_contacts(), settings, None)
    found = integrate(problem, start=(np.zeros(2), np.ones(2)))
    steps = np.array([angle_at(history, t) for t in found.time])
    corners = np.array([angle_at(history, t) for t in (0.4, 1.0, 2.0, 2.5)])
    wanted = np.arange(0.0, steps[-1], 2.0 * np.pi / 60)
    wanted = np.unique(np.concatenate([wanted, corners]).round(12))
    np.testing.assert_allclose(steps, wanted, rtol=1e-9, atol=1e-9)
    assert np.max(np.abs(found.imbalance)) < 1e-12
