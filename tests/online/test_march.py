"""Time integration: the discrete truth of each scheme first, then its order; energy, friction,
steady state, errors."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from support import (
    enriched,
    fixed_steps,
    harmonic,
    linear_model,
    no_contacts,
    one_contact,
    random_model,
    scene_of,
    slope,
)

from fenicsrom.errors import AccuracyError, ConvergenceError
from fenicsrom.online.contact.state import OPEN, SLIP, STICK
from fenicsrom.online.contact.surfaces import Contacts
from fenicsrom.online.model.matrices import DenseModel
from fenicsrom.online.model.model import Problem, ReducedModel
from fenicsrom.online.model.polynomial import elastic_force
from fenicsrom.online.motion.motion import Interrupted, Motion
from fenicsrom.online.run.march import integrate
from fenicsrom.progress import asking, listening
from fenicsrom.scene import Time

Array = NDArray[np.float64]

SCHEMES = ["average-acceleration", "generalised-alpha", "discrete-gradient"]
FREE = no_contacts()


def end(motion: Motion) -> Array:
    """Displacement at the end of a run."""
    return motion.displacement[-1, 0]


def total(motion: Motion) -> Array:
    return motion.kinetic + motion.elastic + motion.contact_energy


def dense_twin(model: ReducedModel) -> DenseModel:
    """The same model as a `DenseModel`: everything in plain numpy."""
    n = model.size

    def elastic(q: Array) -> tuple[Array, Array]:
        force, tangent = np.empty(n), np.empty((n, n))
        elastic_force(model.elastic, q, force, tangent)
        return force, tangent

    def energy(q: Array) -> float:
        return float(elastic_force(model.elastic, q, np.empty(n), np.empty((n, n))))

    return DenseModel(
        model.mass,
        model.damping,
        elastic,
        energy,
        model.loads,
        model.load_histories,
        model.points,
        model.contact_rows,
        model.contact_offset,
        model.probe,
        model.probe_offset,
        linear=model.linear,
        gauss_points=model.gauss_points,
    )


# ------------------------------------------------------------------ linear oscillator


OMEGA = 3.0


def oscillate(scheme: str, steps: int, duration: float = 4.0) -> Motion:
    """A free oscillator of two equal coordinates, from q = (1, 0) and v = (0, omega): cos and
    sin."""
    model = linear_model(2.0 * np.eye(2), 2.0 * OMEGA**2 * np.eye(2))
    start = np.array([1.0, 0.0]), np.array([0.0, OMEGA])
    return integrate(Problem(model, FREE, fixed_steps(scheme, steps, duration), None), start=start)


@pytest.mark.parametrize("scheme", ["average-acceleration", "discrete-gradient"])
def test_period_error_of_oscillator_is_the_known_one(scheme: str) -> None:
    """Both schemes are the trapezoidal rule here, which turns by 2 atan(omega h / 2) per step at
    constant amplitude.

    Reference: period error of each scheme | discrete solution | closed form | agrees | 1e-11
    """
    for steps in (15, 400):
        motion = oscillate(scheme, steps)
        angle = np.arange(steps + 1) * 2 * np.arctan(OMEGA * 4.0 / steps / 2)
        np.testing.assert_allclose(motion.displacement[:, 0, 0], np.cos(angle), atol=1e-11)
        np.testing.assert_allclose(motion.displacement[:, 0, 1], np.sin(angle), atol=1e-11)
        np.testing.assert_allclose(total(motion), 2 * OMEGA**2, rtol=1e-11)
        assert motion.steps == steps and motion.newton_iterations == steps and motion.rejected == 0
        np.testing.assert_allclose(motion.time, np.linspace(0, 4, steps + 1), atol=1e-12)


@pytest.mark.parametrize("radius", [0.0, 0.5, 0.8, 1.0])
def test_generalised_alpha_decays_with_its_spectral_radius(radius: float) -> None:
    """In the limit of large steps the motion shrinks by the spectral radius per step; the overshoot
    creates energy and is refused."""
    model = linear_model(np.eye(2), 1e12 * np.eye(2))
    settings = fixed_steps("generalised-alpha", 60, 60.0, radius)
    start = np.array([1.0, 0.0]), np.zeros(2)
    if radius == 1.0:
        motion = integrate(Problem(model, FREE, settings, None), start=start)
    else:
        with pytest.raises(AccuracyError, match="energy ledger is off by") as refused:
            integrate(Problem(model, FREE, settings, None), start=start)
        motion = refused.value.partial
    late = np.abs(motion.displacement[40:, 0, 0])
    if radius == 0.0:
        assert late.max() < 1e-6
    else:
        assert np.mean(np.diff(np.log(late))) == pytest.approx(np.log(radius), abs=0.05)


@pytest.mark.parametrize("scheme", SCHEMES)
def test_momentum_equals_impulse_of_the_loads(scheme: str) -> None:
    """A free mass under two loads, one harmonic with a phase and one constant."""
    amplitude, omega, phase = (
        np.array([3.0, -2.0]),
        np.array([5.0, 0.0]),
        np.array([0.7, np.pi / 2]),
    )
    model = linear_model(
        4.0, 0.0, loads=[[1.0, 1.0]], load_histories=harmonic(amplitude, omega, phase)
    )
    motion = integrate(Problem(model, no_contacts(), fixed_steps(scheme, 50, 1.0), None))
    time = motion.time
    load = 3.0 * np.sin(5.0 * time + 0.7) - 2.0
    impulse = np.sum(0.5 * (load[1:] + load[:-1]) * np.diff(time))
    momentum = np.sqrt(2 * 4.0 * motion.kinetic[-1])
    if scheme == "generalised-alpha":
        assert momentum == pytest.approx(abs(impulse), rel=2e-2)
    else:
        assert momentum == pytest.approx(abs(impulse), rel=1e-12)
    exact = 3.0 / 5.0 * (np.cos(0.7) - np.cos(5.7)) - 2.0
    assert momentum == pytest.approx(abs(exact), rel=2e-2)


def forced(scheme: str = "discrete-gradient", **settings: Any) -> tuple[Motion, complex]:
    """A damped linear model driven at its second frequency to a steady state, and its exact complex
    amplitude."""
    mass, stiffness = np.diag([1.0, 0.5]), np.array([[40.0, -15.0], [-15.0, 30.0]])
    omega, phase, damping = 6.0, 0.4, 1.2
    loads = np.array([[2.0], [-1.0]])
    load_histories = harmonic(np.array([1.5]), np.array([omega]), np.array([phase]))
    model = linear_model(
        mass, stiffness, damping=damping, loads=loads, load_histories=load_histories
    )
    period = 2 * np.pi / omega
    motion = integrate(
        Problem(model, FREE, Time.of(scheme=scheme, spectral_radius=0.8, **settings), period)
    )
    w = omega
    if settings.get(
        "steps_per_period"
    ):  # the trapezoidal rule sees the tangent in the place of the frequency
        h = period / settings["steps_per_period"]
        w = 2 / h * np.tan(omega * h / 2)
    response = np.linalg.solve(stiffness - w**2 * mass + 1j * w * damping * mass, 1.5 * loads[:, 0])
    return motion, complex(response[0] * np.exp(1j * phase))


def amplitude(motion: Motion, omega: float = 6.0) -> complex:
    """Complex amplitude of the first displacement over the last period: Im(a exp(i omega t))."""
    span = motion.last_period()
    t, x = motion.time[span], motion.displacement[span, 0, 0]
    s, c = np.linalg.lstsq(np.stack([np.sin(omega * t), np.cos(omega * t)], axis=1), x, rcond=None)[
        0
    ]
    return complex(s, c)


@pytest.mark.parametrize("scheme", ["average-acceleration", "discrete-gradient"])
def test_steady_state_matches_the_known_amplitude(scheme: str) -> None:
    march = {"steps_per_period": 40, "periods": 200, "steady": "march"}
    motion, exact = forced(scheme, **march, steady_tolerance=1e-9)
    assert motion.steady and 10 < motion.periods < 60
    assert motion.steps == 40 * motion.periods == motion.time.size - 1
    assert abs(amplitude(motion) - exact) < 1e-8 * abs(exact)
    span = motion.last_period()
    assert span.stop - span.start == 41
    loose, _ = forced(scheme, **march, steady_tolerance=1e-3)
    assert loose.steady and loose.periods < motion.periods
    found, _ = forced(scheme, **march | {"steady": "newton"}, steady_tolerance=1e-9)
    assert found.steady and found.periods == 7 and found.steps == 280 == found.time.size - 1
    assert abs(amplitude(found) - exact) < 1e-8 * abs(exact)


def test_tolerance_of_zero_or_not_met_runs_all_periods() -> None:
    for tolerance in (0.0, 1e-6):
        motion, _ = forced(steps_per_period=20, periods=4, steady_tolerance=tolerance)
        assert not motion.steady and motion.periods == 4 and motion.steps == 80


@pytest.mark.slow
@pytest.mark.parametrize("tolerance", [1e-3, 1e-4, 1e-5])
def test_steady_state_with_adaptive_step_is_detected(tolerance: float) -> None:
    """The steps differ from period to period."""
    _, limit = forced(steps_per_period=100_000, periods=1, steady_tolerance=0.5)
    motion, _ = forced(tolerance=tolerance, periods=60, steady_tolerance=1e-6)
    assert motion.steady
    assert abs(amplitude(motion) - limit) < tolerance ** (2 / 3) * abs(limit)


# ------------------------------------------------------------------ nonlinear, without contact


@pytest.mark.slow
def test_energy_over_a_hundred_thousand_steps_is_constant() -> None:
    """To 1e-10, for steps of a tenth and of a third of a radian of the fastest mode, in the
    compiled loop.

    Reference: energy of a free nonlinear motion, 100,000 steps | conservation | constant | constant
    | 1e-10
    """
    model = random_model(3, seed=3)
    for step in (0.05, 0.2):
        settings = fixed_steps("discrete-gradient", 100_000, 1e5 * step)
        motion = integrate(Problem(model, FREE, settings, None), start=START)
        energy = total(motion)
        assert motion.steps == 100_000 and np.abs(energy / energy[0] - 1).max() < 1e-10
        assert np.ptp(motion.kinetic) > 0.3 * energy[0]


@pytest.mark.parametrize("method", ["rubin", pytest.param("craig-bampton", marks=pytest.mark.slow)])
@pytest.mark.slow
def test_energy_of_the_papers_beam_is_constant(method: str, beam2d: Any) -> None:
    from fenicsrom.reduction.basis import project

    _, _, basis = enriched(beam2d, method, 1)
    model = project(beam2d, basis)._replace(
        damping=0.0, load_histories=harmonic(np.zeros(1), np.ones(1), np.zeros(1))
    )
    first = basis.labels.index("1V")
    v = np.zeros(basis.size)
    v[first] = np.sqrt(
        2 * 20.0 / model.mass[first, first]
    )  # 20 J: the tip swings as far as in the paper
    settings = fixed_steps("discrete-gradient", 100_000, 500 / 3.28)
    motion = integrate(Problem(model, off(beam2d), settings, None), start=(np.zeros(basis.size), v))
    energy = total(motion)
    assert energy[0] == pytest.approx(20.0)
    assert np.abs(motion.displacement[:, 0, 1]).max() > 0.1
    assert np.abs(energy / energy[0] - 1).max() < 1e-10


def off(solid: Any) -> Contacts:
    """The contact of the scene, too far away to touch."""
    count = len(scene_of(solid).contacts)
    return one_contact(preload=[0.0] * count, gap=1e3)


def reference(
    model: ReducedModel, contacts: Contacts, start: tuple[Array, Array], duration: float
) -> Array:
    """Displacement at the end by an explicit scheme of high order; contacts without friction."""
    n, m = model.size, model.contact_offset.size
    force, tangent = np.empty(n), np.empty((n, n))
    inverse = np.linalg.inv(model.mass)

    def rate(t: float, y: Array) -> Array:
        elastic_force(model.elastic, y[:n], force, tangent)
        right = model.load(t) - force - model.damping * model.mass @ y[n:]
        for p in range(m // 2):
            right[2 * p] -= max(
                0.0,
                contacts.preload[p]
                + contacts.normal_stiffness[p] * (y[2 * p] - contacts.radius[p]),
            )
        return np.concatenate([y[n:], inverse @ right])

    found = solve_ivp(
        rate,
        (0, duration),
        np.concatenate(start),
        method="DOP853",
        rtol=1e-12,
        atol=1e-13,
        max_step=duration / 4000,
    )
    return found.y[:2, -1]


AT_REST = np.zeros(3), np.zeros(3)
START = np.array([0.8, -0.5, 0.4]), np.array([0.2, 0.3, -0.4])


@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.slow
def test_error_of_nonlinear_problem_is_of_second_order(scheme: str) -> None:
    """Reference: order of each scheme on a nonlinear problem | scipy, order 8 | 2 | 2 | 0.15"""
    model = random_model(3, seed=3, damping=0.1, force=0.5, omega=1.3)
    exact = reference(model, FREE, START, 6.0)
    steps = np.array([200, 400, 800])
    errors = []
    for n in steps:
        motion = integrate(Problem(model, FREE, fixed_steps(scheme, n, 6.0), None), start=START)
        errors.append(np.abs(end(motion) - exact).max())
    assert slope(1 / np.array(steps), errors) == pytest.approx(2.0, abs=0.15)
    assert errors[-1] < 2e-3


def knocking() -> tuple[ReducedModel, Contacts]:
    """A nonlinear model that hits a spring without friction and retreats."""
    model = random_model(3, seed=3, masters=2, damping=0.1, force=0.5, omega=1.3)
    return model, one_contact(gap=0.1, normal_stiffness=20.0)


@pytest.mark.slow
@pytest.mark.parametrize("scheme", SCHEMES)
def test_error_with_lift_off_is_of_second_order(scheme: str) -> None:
    """A contact that opens within a step keeps the order: the force has a kink, not a jump."""
    model, contacts = knocking()
    exact = reference(model, contacts, START, 6.0)
    steps = np.array([300, 420, 600, 850, 1200, 1700, 2400])
    errors = []
    for n in steps:
        motion = integrate(Problem(model, contacts, fixed_steps(scheme, n, 6.0), None), start=START)
        assert np.count_nonzero(np.diff(motion.state[:, 0] == OPEN)) >= 4
        errors.append(np.abs(end(motion) - exact).max())
    assert slope(1 / np.array(steps), errors) == pytest.approx(2.0, abs=0.25)


def dropped(steps: int, stiffness: float, duration: float = 4.0) -> Motion:
    """A mass that a constant load drops on a stiff spring; a second mass is attached to it."""
    load_histories = harmonic(np.array([1.0]), np.array([0.0]), np.array([np.pi / 2]))
    chain = np.array([[4.0, -4.0], [-4.0, 5.0]])
    model = linear_model(
        np.diag([0.1, 1.0]), chain, loads=[[0.0], [1.0]], load_histories=load_histories, masters=2
    )
    contacts = one_contact(gap=0.05, normal_stiffness=stiffness)
    settings = fixed_steps("discrete-gradient", steps, duration)
    return integrate(Problem(model, contacts, settings, None), start=(np.zeros(2), np.zeros(2)))


def test_contact_too_stiff_for_the_step_does_not_ring() -> None:
    """The force is that of a body at rest on the spring, and does not alternate from step to
    step."""
    motion = dropped(200, 1e8)
    closed = motion.force[:, 0, 0] > 0.0
    assert np.count_nonzero(closed) > 20
    runs = np.split(motion.force[:, 0, 0], np.flatnonzero(np.diff(closed.astype(int))) + 1)
    longest = max((run for run in runs if run[0] > 0.0), key=len)
    assert len(longest) > 20  # it stays closed
    assert np.abs(np.diff(longest[2:])).max() < 0.2 * longest[2:].max()
    assert motion.relative_imbalance < 1e-10 and np.all(
        np.diff(motion.damping_dissipation) > -1e-13
    )
    assert motion.damping_dissipation[-1] > 0.0  # the impact


def test_contact_resolved_by_the_step_loses_no_energy() -> None:
    """The dissipation of the blended normal force falls with a high power of the step."""
    lost = [dropped(steps, 50.0).damping_dissipation[-1] for steps in (400, 800, 1600)]
    assert lost[0] < 1e-3 * dropped(400, 50.0).kinetic.max()
    assert slope([1.0, 0.5, 0.25], lost) > 3.0


# ------------------------------------------------------------------ friction


def rubbing(**values: float) -> tuple[ReducedModel, Contacts]:
    """A nonlinear model that sticks, slips and lifts off."""
    model = random_model(3, seed=5, masters=2, damping=0.2, force=2.0, omega=1.1)
    given = {"preload": 0.3, "normal_stiffness": 5.0, "tangential_stiffness": 8.0, "friction": 0.6}
    return model, one_contact(**(given | values))


PERIOD = 2 * np.pi / 1.1


TOLERANT = pytest.param(SCHEMES[2], {"tolerance": 1e-3}, marks=pytest.mark.slow)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("scheme", "settings"), [*((name, {"steps_per_period": 50}) for name in SCHEMES), TOLERANT]
)
def test_compiled_loop_equals_plain_python(scheme: str, settings: dict[str, Any]) -> None:
    """Compiled, in plain Python, and in plain Python on a dense model."""
    model, contacts = rubbing()
    time = Time.of(scheme=scheme, periods=3, steady_tolerance=0.0, spectral_radius=0.8, **settings)
    fast = integrate(Problem(model, contacts, time, PERIOD), keep_coordinates=True)
    assert {OPEN, SLIP, STICK} == set(fast.state.ravel())
    for slow in (
        integrate(Problem(model, contacts, time, PERIOD), keep_coordinates=True, compiled=False),
        integrate(Problem(dense_twin(model), contacts, time, PERIOD), keep_coordinates=True),
    ):
        assert (slow.steps, slow.rejected, slow.periods) == (
            fast.steps,
            fast.rejected,
            fast.periods,
        )
        np.testing.assert_array_equal(slow.state, fast.state)
        names = """
            time displacement force kinetic elastic work friction_dissipation gap mean_force
            coordinates
        """.split()
        for name in names:
            one, two = getattr(fast, name), getattr(slow, name)
            np.testing.assert_allclose(
                two, one, rtol=0, atol=1e-8 * np.abs(one).max(), err_msg=name
            )


def ledger(scheme: str, steps: int) -> float:
    model, contacts = rubbing()
    time = Time.of(
        scheme=scheme, periods=2, steady_tolerance=0.0, steps_per_period=steps, spectral_radius=0.8
    )
    motion = integrate(Problem(model, contacts, time, PERIOD))
    assert {OPEN, SLIP, STICK} == set(motion.state.ravel())
    assert (
        motion.friction_dissipation[-1] > 0.05 * motion.kinetic.max()
        and motion.damping_dissipation[-1] > 0
    )
    assert np.all(
        np.diff(motion.friction_dissipation) > -1e-12
    )  # friction takes energy, in every step
    gained, lost = (
        total(motion) - total(motion)[0],
        motion.damping_dissipation + motion.friction_dissipation,
    )
    np.testing.assert_allclose(motion.imbalance, gained + lost - motion.work, atol=1e-12)
    return motion.relative_imbalance


def test_ledger_of_discrete_gradient_closes_in_every_step() -> None:
    for steps in (12, 50):
        assert ledger("discrete-gradient", steps) < 1e-10


@pytest.mark.parametrize("scheme", ["average-acceleration", "generalised-alpha"])
def test_ledger_of_other_schemes_closes_with_the_step(scheme: str) -> None:
    steps = [100, 140, 200, 280, 400, 560, 800]
    errors = [ledger(scheme, n) for n in steps]
    assert errors[-1] < 1e-3
    assert slope(1 / np.array(steps), errors) == pytest.approx(2.0, abs=0.4)


def test_two_uncoupled_contacts_move_as_two_runs() -> None:
    """Two uncoupled oscillators with one contact each move as in two separate runs."""
    load_histories = harmonic(np.array([1.0]), np.array([2.0]), np.array([0.0]))
    stiffness = [np.array([[9.0, 2.0], [2.0, 6.0]]), np.array([[5.0, -1.0], [-1.0, 8.0]])]
    touch = [{"preload": 0.2, "friction": 0.3}, {"preload": 0.1, "friction": 0.8}]
    zero = np.zeros((2, 2))
    time = Time.of(periods=2, steady_tolerance=0.0, steps_per_period=60)
    pair = np.block([[stiffness[0], zero], [zero, stiffness[1]]])
    model = linear_model(
        np.eye(4), pair, loads=np.ones(4), load_histories=load_histories, masters=4
    )
    values = {name: [t[name] for t in touch] for name in touch[0]}
    contacts = one_contact(**values, normal_stiffness=3.0, tangential_stiffness=4.0)
    both = integrate(Problem(model, contacts, time, np.pi))
    friction_dissipation = np.zeros(both.time.size)
    for p in (0, 1):
        alone = integrate(
            Problem(
                linear_model(
                    np.eye(2),
                    stiffness[p],
                    loads=np.ones(2),
                    load_histories=load_histories,
                    masters=2,
                ),
                one_contact(**touch[p], normal_stiffness=3.0, tangential_stiffness=4.0),
                time,
                np.pi,
            )
        )
        np.testing.assert_allclose(
            both.displacement[:, p], alone.displacement[:, 0], rtol=0, atol=1e-11
        )
        np.testing.assert_allclose(both.force[:, p], alone.force[:, 0], rtol=0, atol=1e-11)
        friction_dissipation += alone.friction_dissipation
    assert friction_dissipation[-1] > 0
    np.testing.assert_allclose(both.friction_dissipation, friction_dissipation, rtol=0, atol=1e-11)


# ------------------------------------------------------------------ adaptive step, failure


def test_adaptive_step_meets_its_tolerance() -> None:
    model, contacts = rubbing()
    fine = Time.of(periods=2, steady_tolerance=0.0, steps_per_period=20_000)
    exact = integrate(Problem(model, contacts, fine, PERIOD))
    size = np.abs(exact.displacement).max()
    tolerances = np.array([1e-2, 1e-3, 1e-4, 1e-5])
    errors, steps = [], []
    for tolerance in tolerances:
        time = Time.of(periods=2, steady_tolerance=0.0, tolerance=tolerance)
        motion = integrate(Problem(model, contacts, time, PERIOD))
        at = np.array(
            [np.interp(motion.time, exact.time, column) for column in exact.displacement[:, 0].T]
        ).T
        errors.append(np.abs(motion.displacement[:, 0] - at).max() / size)
        steps.append(motion.steps)
    # the tolerance bounds the local errors, of the third order: together they are of the second,
    # tolerance^(2/3)
    assert np.all(np.array(errors) < tolerances ** (2 / 3)), errors
    assert np.all(np.diff(errors) < 0) and np.all(np.diff(steps) > 0)
    assert slope(tolerances, steps) == pytest.approx(-1 / 3, abs=0.1)


def brittle(broken: float) -> DenseModel:
    """A model whose force is not a number beyond a certain displacement."""
    model = random_model(3, seed=5, masters=2, force=2.0, omega=1.1)
    twin = dense_twin(model)
    sound = twin.elastic

    def elastic(q: Array) -> tuple[Array, Array]:
        force, tangent = sound(q)
        return (force * np.nan, tangent) if np.abs(q).max() > broken else (force, tangent)

    twin.elastic = elastic
    return twin


@pytest.mark.slow
@pytest.mark.parametrize("settings", [{"steps_per_period": 50}, {"tolerance": 1e-3}])
def test_failed_step_reports_time_and_state_and_keeps_the_motion(settings: dict[str, Any]) -> None:
    _, contacts = rubbing()
    time = Time.of(periods=3, steady_tolerance=0.0, **settings)
    whole = integrate(
        Problem(brittle(np.inf), contacts, time, PERIOD), keep_coordinates=True, start=AT_REST
    )
    reach = np.abs(whole.coordinates).max()
    sentence = r"stopped at t = \d.*\(point 1 (open|slip|stick); scheme discrete-gradient\)"
    with pytest.raises(ConvergenceError, match=sentence) as failure:
        integrate(Problem(brittle(0.7 * reach), contacts, time, PERIOD), start=AT_REST)
    partial = failure.value.partial
    assert isinstance(partial, Motion) and not partial.steady
    assert partial.steps == partial.time.size - 1 > 5 and partial.rejected > 10
    assert f"t = {partial.time[-1]:.6g} s" in str(failure.value)
    for name in ("displacement", "force", "kinetic", "elastic", "friction_dissipation"):
        assert np.all(np.isfinite(getattr(partial, name)))
    # up to there it is the motion
    same = np.count_nonzero(partial.time[:, None] == whole.time[None, :])
    assert same > 5
    early = partial.time <= 0.5 * partial.time[-1]
    np.testing.assert_allclose(
        partial.displacement[early], whole.displacement[: early.sum()], rtol=0, atol=1e-9
    )


def test_rejected_step_leaves_no_trace() -> None:
    """The force fails in some steps; the motion equals that of smaller steps from the start."""
    _, contacts = rubbing()
    calls = 0
    twin = brittle(np.inf)
    sound = twin.elastic_over_step

    def elastic_over_step(*arguments: Any) -> tuple[Array, Array]:
        nonlocal calls
        calls += 1
        mean, tangent = sound(*arguments)
        return (mean * np.nan, tangent) if 24 < calls < 27 else (mean, tangent)

    twin.elastic_over_step = elastic_over_step  # type: ignore[method-assign]
    settings = fixed_steps("discrete-gradient", 100, 8.0)
    motion = integrate(Problem(twin, contacts, settings, None), start=AT_REST)
    assert motion.rejected == 2
    cut = int(np.flatnonzero(np.diff(motion.time) < 0.99 * 0.08)[0])
    assert motion.state[cut, 0] != OPEN  # where there is a history to lose
    smooth = integrate(Problem(brittle(np.inf), contacts, settings, None), start=AT_REST)
    np.testing.assert_array_equal(motion.displacement[: cut + 1], smooth.displacement[: cut + 1])
    # with the friction history intact the ledger still closes, and both motions agree to the error
    # of a step
    assert motion.relative_imbalance < 1e-10
    assert np.abs(end(motion) - end(smooth)).max() < 2e-2 * np.abs(smooth.displacement).max()


def test_run_of_a_duration_ends_on_it() -> None:
    model, contacts = rubbing()
    for settings in (Time.of(duration=1.0, step=0.3), Time.of(duration=1.0, tolerance=1e-3)):
        motion = integrate(Problem(model, contacts, settings, None))
        assert motion.time[-1] == pytest.approx(1.0, abs=1e-12)
        assert motion.period is None and not motion.steady and motion.periods == 0
        assert motion.last_period() == slice(0, motion.time.size)


def test_listener_hears_the_time_of_the_steps_and_nothing_of_the_equilibrium_before_them() -> None:
    model, contacts = rubbing()
    told: list[float] = []
    time = Time.of(periods=4, steady_tolerance=0.0, steps_per_period=40)
    with listening(told.append):
        integrate(Problem(model, contacts, time, PERIOD))
    assert told == pytest.approx([0.25, 0.5, 0.75, 1.0])


def test_stop_ends_the_run_after_a_period_and_keeps_the_motion() -> None:
    model, contacts = rubbing()
    answers = iter([False, True])
    time = Time.of(periods=5, steady_tolerance=0.0, steps_per_period=40)
    with pytest.raises(Interrupted) as stopped, asking(lambda: next(answers)):
        integrate(Problem(model, contacts, time, PERIOD))
    partial = stopped.value.partial
    assert partial.periods == 2 and partial.steps == 80 and not partial.steady
    whole = integrate(Problem(model, contacts, time, PERIOD))
    np.testing.assert_array_equal(partial.displacement, whole.displacement[:81])
    # from its end the run continues as if it had not been stopped
    rest = integrate(Problem(model, contacts, time, PERIOD), resume=partial.end)
    np.testing.assert_array_equal(rest.displacement[-120:], whole.displacement[-120:])


def test_stop_at_the_end_of_a_run_is_ignored() -> None:
    model, contacts = rubbing()
    time = Time.of(periods=1, steady_tolerance=0.0, steps_per_period=40)
    with asking(lambda: True):
        motion = integrate(Problem(model, contacts, time, PERIOD))
    assert motion.periods == 1
