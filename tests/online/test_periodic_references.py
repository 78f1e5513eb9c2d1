"""Periodic motions against orbits, friction loops and response formulas from other sources.

The references were recomputed by programs that share no code with this one; see the table in
tests/README.md.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray
from support import duffing, harmonic, linear_model, no_contacts, one_contact, period_steps

from fenicsrom.online.contact.points import contacts_of
from fenicsrom.online.contact.state import OPEN
from fenicsrom.online.contact.surfaces import Contacts
from fenicsrom.online.model.model import Problem, ReducedModel
from fenicsrom.online.periodic.period_map import PeriodEnd, PeriodMap
from fenicsrom.online.periodic.shooting import PeriodicMotion, contact_family, periodic_motion
from fenicsrom.online.step.state import scheme
from fenicsrom.online.step.step import DONE
from fenicsrom.online.store.archive import StoredModel
from fenicsrom.scene import read_scene

Array = NDArray[np.float64]

SCHEMES = ["discrete-gradient", "average-acceleration", "generalised-alpha"]

# ------------------------------------------------------------------ Duffing oscillators


class Orbit(NamedTuple):
    """A periodic orbit of a Duffing oscillator: start, multipliers and harmonics."""

    oscillator: tuple[float, float, float, float]  # damping, cubic, force, omega
    start: tuple[float, float]
    multipliers: tuple[complex, complex]
    harmonics: tuple[float, ...]  # amplitudes of the first and third harmonic
    verdict: str


THREE, OTHER = (0.05, 1.0, 0.3, 1.5), (0.1, 0.2, 3.0, 0.8)
UPPER, LOWER = 0.52172701 + 0.73405696j, -0.29425625 + 0.85114743j
ORBITS = {
    "upper": Orbit(
        THREE,
        (1.30722027, 0.87306771),
        (UPPER, UPPER.conjugate()),
        (1.3721947959, 0.0394233432),
        "stable",
    ),
    "saddle": Orbit(THREE, (-1.1, 0.5), (2.124463, 0.381762), (1.1426581, 0.0215927), "fold"),
    "lower": Orbit(
        THREE,
        (-0.24849689, 0.02338837),
        (LOWER, LOWER.conjugate()),
        (0.2487814011, 2.009248e-4),
        "stable",
    ),
    "other": Orbit(OTHER, (2.3, 0.3), (0.9820826, 0.4642564), (2.3469754,), "stable"),
}


def harmonics(motion: PeriodicMotion, orders: Any) -> Array:
    """Amplitudes of the harmonics of the probe, for equal steps."""
    x = motion.record.probe[:, 0]
    waves = np.exp(-1j * np.outer(orders, 2.0 * np.pi * motion.record.time / motion.period))
    return np.asarray(np.abs(2.0 / x.size * waves @ x))


def measured(orbit: Orbit, steps: int, name: str) -> tuple[NDArray[np.complex128], Array, str]:
    """(the two largest multipliers and the harmonics, start, verdict) of an orbit."""
    model, period = duffing(*orbit.oscillator)
    start = np.array(orbit.start[:1]), np.array(orbit.start[1:]), np.zeros((0, 2))
    motion = periodic_motion(
        Problem(model, no_contacts(), period_steps(steps, name), period), start
    )
    two = motion.multipliers[:2]
    two = two[np.lexsort((-two.imag, -two.real))]
    sizes = harmonics(motion, np.arange(1, 2 * len(orbit.harmonics), 2))
    return np.concatenate([two, sizes]), motion.z[:2], motion.verdict


@pytest.mark.slow
@pytest.mark.parametrize("name", SCHEMES)
@pytest.mark.parametrize("key", ORBITS)
def test_duffing_orbit_converges_to_reference_with_second_order(key: str, name: str) -> None:
    """Reference: orbits of a Duffing oscillator: multipliers | recomputed | 0.52172701 ±
    0.73405696i; 2.124463, 0.381762; … | 3e-7; order 2 | 1e-6
    """
    orbit = ORBITS[key]
    coarse, middle, fine = (measured(orbit, steps, name) for steps in (400, 800, 1600))
    reference = np.array([*orbit.multipliers, *orbit.harmonics])
    errors = [np.abs(found[0] - reference) for found in (coarse, middle)]
    ratios = errors[0] / errors[1]
    assert np.all((ratios > 3.5) & (ratios < 4.5)), ratios
    limit = (4.0 * fine[0] - middle[0]) / 3.0
    assert np.abs(limit - reference).max() < 1e-6
    damping, _, _, omega = orbit.oscillator
    assert abs(limit[0] * limit[1] - np.exp(-damping * 2.0 * np.pi / omega)) < 1e-6
    if key in ("upper", "lower"):
        np.testing.assert_allclose((4.0 * fine[1] - middle[1]) / 3.0, orbit.start, atol=1e-6)
    assert {found[2] for found in (coarse, middle, fine)} == {orbit.verdict}


# ------------------------------------------------------------------ prescribed motions

RATE = 2.0 * np.pi  # of the prescribed motions, rad/s: the period is 1 s


class Loop(NamedTuple):
    """A period of a contact point with a prescribed motion and its periodic slider."""

    pmap: PeriodMap
    model: ReducedModel
    end: PeriodEnd
    omega: float  # sqrt(stiffness / mass), rad/s
    mass: float

    @property
    def loss(self) -> float:
        """Energy dissipated by friction, J."""
        return float(self.end.record.friction_dissipation[-1].sum())


def prescribed(
    contacts: Contacts,
    start: Any,
    steps: int,
    *,
    mass: float = 1e9,
    shift: float = 0.0,
    varied: Any = None,
) -> Loop:
    """A contact point that moves on an ellipse, x + i v / omega = start exp(-2 pi i (t + shift h)).

    Its masses are so heavy that the contact does not change the motion. Their springs are tuned so
    that the ends of the steps are on the ellipse: omega h / 2 = tan(pi h). The slider is made
    periodic by Newton's method.

    Args:
        contacts: one point in d dimensions.
        start: (d,) complex, the normal direction first, m.
        steps: N, of size h = 1/N.
        mass: of each direction, kg.
        shift: of the grid, in steps.
        varied: see `Problem`.
    """
    d = contacts.centre.shape[1]
    omega = 2.0 * steps * np.tan(np.pi / steps)
    model = linear_model(mass * np.eye(d), mass * omega**2 * np.eye(d), masters=d)
    problem = Problem(model, contacts, None, 1.0, varied)
    grid = np.linspace(0.0, 1.0, steps + 1)
    pmap = PeriodMap(problem, scheme("discrete-gradient", model), grid)
    u = np.asarray(start, dtype=np.complex128) * np.exp(-2j * np.pi * shift / steps)
    z = pmap.pack(u.real, omega * u.imag, np.zeros(d), u.real[None])
    for _ in range(20):
        status, end = pmap(problem, z)
        assert status == DONE
        change = end.z[2 * d :] - z[2 * d :]
        if np.abs(change).max() < 1e-13:
            return Loop(pmap, model, end, omega, mass)
        z[2 * d :] += np.linalg.solve(np.eye(d - 1) - end.matrix[2 * d :, 2 * d :], change)
    raise AssertionError("the slider does not repeat")


def first_harmonic(loop: Loop) -> complex:
    """Cosine and, as imaginary part, sine coefficient of the friction, constant within a step."""
    record = loop.end.record
    ends = np.exp(1j * RATE * np.concatenate([[0.0], record.time]))
    return complex(2.0 * np.sum(record.mean_force[:, 0, 1] * np.diff(ends)) / (1j * RATE))


JENKINS = one_contact(preload=2.0, friction=0.5)


@pytest.mark.parametrize("a", [1.2, 1.7, 2.0, 5.0])
def test_jenkins_element_has_exact_loss_and_first_harmonic(a: float) -> None:
    """Reference: loss and first harmonic of a Jenkins element | closed form | 4 μN (A − μN/k_t) |
    2e-10; 7e-8 A | 1e-9; 1e-7 A
    """
    loop = prescribed(JENKINS, [0.0, a], 10_000)
    theta = np.arccos(1.0 - 2.0 / a)
    cosine = a * (theta - 0.5 * np.sin(2.0 * theta)) / np.pi
    assert loop.loss == pytest.approx(4.0 * (a - 1.0), abs=1e-9)
    exact = complex(cosine, -4.0 / np.pi * (1.0 - 1.0 / a))
    assert abs(first_harmonic(loop) - exact) < 1e-7 * a


@pytest.mark.parametrize("shift", [0.0, 0.5])
def test_jenkins_loss_at_128_steps_is_smooth_in_the_amplitude(shift: float) -> None:
    """The only error is that of the turning points, which a shifted grid misses: a cos(pi/N)."""
    sizes = np.linspace(1.5, 1.6, 41)
    losses = np.array([prescribed(JENKINS, [0.0, a], 128, shift=shift).loss for a in sizes])
    reach = np.cos(2.0 * np.pi * shift / 128)
    np.testing.assert_allclose(losses, 4.0 * (sizes * reach - 1.0), rtol=0.0, atol=1e-9)


#  N0, N1, phi, loss, first harmonic
YANG_MENQ = [
    (1.0, 0.5, 0.0, 2.857142857143, 0.404941509991 - 0.454728408834j),
    (1.0, 0.5, np.pi / 2, 2.984496122239, 0.386750287496 - 0.474997310493j),
    (1.0, 2.0, 0.0, 1.5, 0.75 - 0.238732414638j),
    (1.0, 2.0, np.pi / 2, 4.006078462608, 0.333870427617 - 0.637587189738j),
    (1.0, 2.0, np.pi / 4, 3.712623743418, 0.558507017620 - 0.590882420605j),
    (-0.5, 2.0, np.pi / 3, 1.863781260595, 0.171259410619 - 0.296630000466j),
]


def varying(n0: float, n1: float, phi: float, steps: int, **options: Any) -> Loop:
    """Yang and Menq's point: x = 2 cos(theta), normal force max(0, n0 + n1 cos(theta + phi))."""
    contacts = one_contact(preload=n0, friction=0.5)
    at = contact_family(
        Problem(linear_model(np.eye(2), np.eye(2), masters=2), contacts, None, 1.0), "preload"
    )
    start = [n1 * np.exp(-1j * phi), 2.0]
    return prescribed(contacts, start, steps, varied=at(n0).varied, **options)


@pytest.mark.parametrize(("n0", "n1", "phi", "loss", "harmonic_of_friction"), YANG_MENQ)
def test_varying_normal_load_has_loss_and_first_harmonic_of_yang_and_menq(
    n0: float, n1: float, phi: float, loss: float, harmonic_of_friction: complex
) -> None:
    """Reference: friction under a varying normal load: loss, first harmonic | Yang and Menq (1998),
    recomputed | 2.857142857143, …; 0.404941509991, … | 1.7e-6; 4e-7 | 2e-6; 1e-6
    """
    loop = varying(n0, n1, phi, 4000)
    assert loop.loss == pytest.approx(loss, abs=2e-6)
    assert abs(first_harmonic(loop) - harmonic_of_friction) < 1e-6
    assert (OPEN in loop.end.record.state) == (abs(n1) > n0)


def harmonic_derivatives(n0: float, n1: float, phi: float, steps: int, shift: float) -> Array:
    """Derivatives (4,) of cosine + i sine coefficient by n0, n1, phi and the amplitude.

    In a period the contact moves the masses, which are in resonance with it, by its first harmonic
    only: cosine + i sine = i M omega^2 (change of x + i v / omega) / pi. What the masses do without
    the contact is subtracted.
    """
    loop = varying(n0, n1, phi, steps, mass=1e8, shift=shift)
    point = one_contact(preload=-1e9)
    free = loop.pmap(Problem(loop.model, point, None, 1.0), np.zeros(5))[1].matrix
    end, omega = loop.end, loop.omega
    structure, w = slice(0, 4), 4
    by = np.column_stack(
        [end.matrix[structure, structure] - free[structure, structure], end.by_parameter[structure]]
    )
    slider = np.append(end.matrix[w, structure], end.by_parameter[w]) / (1.0 - end.matrix[w, w])
    by += np.outer(end.matrix[structure, w], slider)
    origin = np.exp(2j * np.pi * shift / steps)
    harmonic_by = 1j * loop.mass * omega**2 / np.pi * (by[1] + 1j * by[3] / omega) * origin

    def along(k: int, motion: complex) -> complex:
        """By a start of direction k that moves x + i v / omega by `motion`."""
        motion = motion / origin
        return complex(harmonic_by[k] * motion.real + harmonic_by[2 + k] * omega * motion.imag)

    turn = complex(np.exp(-1j * phi))
    return np.array([harmonic_by[4], along(0, turn), along(0, -1j * n1 * turn), along(1, 1.0)])


def test_derivatives_of_friction_under_varying_normal_load_match_reference() -> None:
    """The step is a chord of the ellipse, so an event in it has an error of first order in its
    derivatives. The mean over shifted grids removes most of it.

    Reference: derivatives of this harmonic | recomputed | ∂/∂N₀ = (0.20393569, −0.22943052), … |
    2.6e-5 | 5e-5
    """
    shifts = (np.arange(8) + 0.5) / 8.0
    found = np.mean([harmonic_derivatives(1.0, 2.0, np.pi / 4, 2000, s) for s in shifts], axis=0)
    reference = {
        "n0": 0.20393569 - 0.22943052j,
        "n1": 0.21430922 - 0.13819460j,
        "phi": -0.47698705 - 0.44519931j,
        "a": -0.03702355 - 0.04253135j,
    }
    for value, (name, exact) in zip(found, reference.items(), strict=True):
        assert abs(value - exact) < 5e-5, name


@pytest.mark.parametrize("ratio", [1.05, 1.5, 3.0])
def test_circular_orbit_has_friction_and_loss_of_the_periodic_slider(ratio: float) -> None:
    """Reference: circle with friction in 3D: force, loss | closed form | – | 1.4e-7 | 2e-7"""
    stiffness, limit = 2.0, 0.6
    contacts = one_contact(3, preload=2.0, friction=0.3, tangential_stiffness=stiffness)
    critical = limit / stiffness
    r = ratio * critical
    found = []
    for steps in (200, 400, 800):
        loop = prescribed(contacts, [0.0, r, 1j * r], steps)
        record = loop.end.record
        x = record.displacement[:, 0, 1] + 1j * record.displacement[:, 0, 2]
        force = record.force[:, 0, 1] + 1j * record.force[:, 0, 2]
        turned = force * np.conj(x) / r
        assert np.ptp(turned.real) + np.ptp(turned.imag) < 1e-9  # it turns with the point
        found.append([turned[0].real, abs(turned[0].imag), loop.loss])
    reference = np.array(
        [
            stiffness * critical**2 / r,
            limit * np.sqrt(1.0 - 1.0 / ratio**2),
            2.0 * np.pi * limit * np.sqrt(r**2 - critical**2),
        ]
    )
    coarse, middle, fine = np.array(found)
    ratios = (coarse - reference) / (middle - reference)
    assert np.all((ratios > 3.8) & (ratios < 4.2)), ratios
    np.testing.assert_allclose((4.0 * fine - middle) / 3.0, reference, rtol=2e-7)


# ------------------------------------------------------------------ Den Hartog

# ratio of frequencies, friction by load, amplitude by static deflection
WITHOUT_STOPS = [
    (1.5, 0.3, 0.72111026),
    pytest.param(1.25, 0.5, 1.28255685, marks=pytest.mark.slow),
    pytest.param(0.8, 0.3, 2.62610488, marks=pytest.mark.slow),
    pytest.param(0.7, 0.5, 1.74425394, marks=pytest.mark.slow),
    (2.0, 0.2, 0.31797973),
]
# .., part of the period at rest
WITH_STOPS = [(0.6, 0.7, 1.35193093, 0.120), (0.5, 0.6, 1.25159434, 0.219)]


def den_hartog(beta: float, friction: float, stiffness: float, steps: int) -> PeriodicMotion:
    """x'' + x + friction = cos(beta t), with the limit of friction given, on an elastic slider.

    The normal coordinate is so heavy that the normal force is the preload.
    """
    heavy = 1e9
    model = linear_model(
        np.diag([heavy, 1.0]),
        np.diag([np.sqrt(2.0) * heavy, 1.0]),
        loads=[[0.0], [1.0]],
        load_histories=harmonic(np.ones(1), np.array([beta]), np.array([0.5 * np.pi])),
        masters=2,
    )
    contacts = one_contact(preload=1.0, friction=friction, tangential_stiffness=stiffness)
    size = 1.0 / (1.0 - beta**2)
    start = np.array([0.0, size]), np.zeros(2), np.array([[0.0, size]])
    return periodic_motion(Problem(model, contacts, period_steps(steps), 2.0 * np.pi / beta), start)


@pytest.mark.slow
@pytest.mark.parametrize(("beta", "friction", "amplitude"), WITHOUT_STOPS)
def test_den_hartog_amplitude_is_the_limit_of_a_stiff_slider(
    beta: float, friction: float, amplitude: float
) -> None:
    """Each reversal takes half a period of the mass on its slider, so the error falls as
    1/sqrt(k_t).

    Reference: oscillator with Coulomb friction, five cases: amplitude | Den Hartog (1931) |
    0.72111026, 1.28255685, 2.62610488, … | 1e-4 for k_t → ∞ | 2e-4
    """
    found = [den_hartog(beta, friction, k, 4000).amplitude[0, 1] for k in (1e3, 1e4, 1e5)]
    root = np.sqrt(10.0)
    assert (found[0] - amplitude) / (found[1] - amplitude) == pytest.approx(root, abs=0.15)
    limit = (root * found[2] - found[1]) / (root - 1.0)
    assert limit == pytest.approx(amplitude, rel=2e-4)


@pytest.mark.slow
@pytest.mark.parametrize(("beta", "friction", "amplitude", "stuck"), WITH_STOPS)
def test_den_hartog_motion_with_stops_is_the_limit_of_a_stiff_slider(
    beta: float, friction: float, amplitude: float, stuck: float
) -> None:
    """Reference: oscillator with Coulomb friction and stops, two cases: amplitude | recomputed |
    1.35193093, 1.25159434 | 1.351925, 1.251594 | 1e-5
    """
    motions = [den_hartog(beta, friction, k, 4000) for k in (1e4, 1e6)]
    errors = [abs(motion.amplitude[0, 1] - amplitude) for motion in motions]
    assert errors[0] < 5e-4 and errors[1] < 1e-5
    x = np.abs(motions[1].displacement[:, 0, 1])
    # the mass leaves its stop with the third power of the time
    near, far = (np.mean(x > x.max() - reach) for reach in (1e-5, 8e-5))
    assert 2.0 * near - far == pytest.approx(stuck, abs=6e-3)


# ------------------------------------------------------------------ a friction damper

# friction, frequency of the peak by harmonic balance, amplitude
DAMPER = [(0.4, 100.326842, 2.637967e-3), (1.192735, 104.900279, 1.1814358e-3)]
DAMPER += [(2.0, 107.441708, 1.3817679e-3)]


@pytest.mark.parametrize(("friction", "omega", "amplitude"), DAMPER)
def test_friction_damper_moves_as_another_program_says(
    friction: float, omega: float, amplitude: float
) -> None:
    """x'' + 2 x' + 10⁴ x + friction = sin ωt, with the slider on 2000 N/m (Griffin 1980).

    Reference: friction damper: three amplitudes | another program | 2.637967 mm, … | agree | 1e-6
    """
    heavy = 1e9
    model = linear_model(
        np.diag([heavy, 1.0]),
        np.diag([1e4 * heavy, 1e4]),
        damping=2.0,
        loads=[[0.0], [1.0]],
        load_histories=harmonic(np.ones(1), np.array([omega]), np.zeros(1)),
        masters=2,
    )
    contacts = one_contact(preload=1.0, friction=friction, tangential_stiffness=2e3)
    slider = np.array([[0.0, min(0.0, friction / 2e3 - amplitude)]])
    start = np.array([0.0, -amplitude]), np.zeros(2), slider  # a quarter of a period behind
    problem = Problem(model, contacts, period_steps(4000), 2.0 * np.pi / omega)
    assert periodic_motion(problem, start).amplitude[0, 1] == pytest.approx(amplitude, rel=1e-6)


# ------------------------------------------------------------------ a beam that slips and lifts off


@pytest.fixture(scope="module")
def slip_liftoff() -> StoredModel:
    """The reduced model of the demo, of ten coordinates."""
    pytest.importorskip("dolfinx")
    from fenicsrom.study import build_model

    return build_model(read_scene(Path(__file__).parents[2] / "demos" / "slip_liftoff_2d.toml"))


STRONG = (
    "loads.0.force=500",
    "loads.0.frequency=3.25",
    "contacts.0.preload=20",
    "contacts.0.friction=0.2",
)
# changes of the demo, amplitude across and along in mm, largest multiplier
BEAM = [((), 157.58850, 2.842578, 0.99981), (STRONG, 861.48418, 88.66845, 0.99980)]


def steady_beam(stored: StoredModel, name: str, changes: tuple[str, ...]) -> PeriodicMotion:
    """The periodic motion after five marched periods of 200 steps."""
    time = (f'time.scheme="{name}"', "time.periods=5", "time.steps_per_period=200")
    changed = stored.with_overrides([*changes, *time])
    scene, model = changed.scene, changed.model
    assert scene.period is not None
    contacts = contacts_of(scene, model.points)
    return periodic_motion(
        Problem(model, contacts, scene.time, scene.period), changed.simulate().end
    )


@pytest.mark.parametrize(("changes", "across", "along", "multiplier"), BEAM)
def test_beam_with_slip_and_lift_off_matches_the_prototype(
    slip_liftoff: StoredModel,
    changes: tuple[str, ...],
    across: float,
    along: float,
    multiplier: float,
) -> None:
    """Reference: the paper's beam, two cases: amplitude, largest multiplier | prototype in plain
    Python | 157.58850 mm, 0.99981; 861.48418 mm, 0.99980 | agree | all digits
    """
    found = steady_beam(slip_liftoff, "discrete-gradient", changes)
    assert found.residuals[-1] < 1e-10 and len(found.residuals) <= 8
    assert 1e3 * found.amplitude[0, 1] == pytest.approx(across, abs=1e-5)
    assert 1e3 * found.amplitude[0, 0] == pytest.approx(along, abs=2e-6)
    assert abs(found.multipliers[0]) == pytest.approx(multiplier, abs=1e-5)
    assert found.stable and found.free_sliders == 0


@pytest.mark.parametrize("name", SCHEMES[1:])
@pytest.mark.parametrize(("changes", "across", "along", "multiplier"), BEAM)
def test_other_schemes_find_the_motion_of_the_beam(
    slip_liftoff: StoredModel,
    name: str,
    changes: tuple[str, ...],
    across: float,
    along: float,
    multiplier: float,
) -> None:
    found = steady_beam(slip_liftoff, name, changes)
    assert found.residuals[-1] < 1e-10 and len(found.residuals) <= 10
    assert 1e3 * found.amplitude[0, 1] == pytest.approx(across, rel=2e-4)
    assert 1e3 * found.amplitude[0, 0] == pytest.approx(along, rel=5e-4)
    assert found.stable and found.free_sliders == 0
    # generalised-alpha damps the axial waves
    assert abs(found.multipliers[0]) < multiplier + 1e-5
