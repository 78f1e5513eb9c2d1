"""A motion at a speed of rotation that varies: amplitudes by revolutions, and the shaft.

Amplitudes are measured from the equilibrium at the present speed. With the angular momentum L of
the body about the axis and the moments M of the loads and of the contacts about it, the shaft turns
the body with the torque

    tau = dL/dt − M.    (1)

Its work, the integral of tau Ω, is that of the mean torques and speeds of the steps. It speeds the
body up, and it pays for what the loads and the casing take: M Ω. Nearly all the heat of friction
comes from the shaft.
"""

from dataclasses import dataclass

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.assess.rotation.critical_speeds import FrequencyCurve
from fenicsrom.assess.rotation.rotating_modes import RangeBody, modes_at_speed
from fenicsrom.online.contact.points import ContactPoints, paired
from fenicsrom.online.contact.surfaces import angle_at, speed_at
from fenicsrom.online.model.turning import rest_energy
from fenicsrom.online.motion.motion import Motion
from fenicsrom.online.step.speed_range import SNAPSHOTS, RangeModel
from fenicsrom.online.store.archive import StoredModel
from fenicsrom.scene import Scene
from fenicsrom.scene.keys.excitation import excited_orders


@dataclass(frozen=True, eq=False)
class RunUp:
    """A motion at a varying speed, by its k whole revolutions; a shorter motion is one row.

    Attributes:
        time: (k,) end of each revolution, s.
        speed: (k,) mean speed, rad/s.
        amplitude: (k,) largest distance of a contact point from the equilibrium of the present
            speed, m; of the probe without contact, or with one between bodies.
        peak_force: (k,) largest normal force, N.
        friction: (k,) energy dissipated by friction, J.
        torque: (k,) mean torque of the shaft (1), N m.
        power: (k,) its mean power, W.
        shaft_work: work of the shaft in the whole run, J.
        contact_work: work that the contacts take from the shaft, J.
        load_work: work that the loads take from the shaft, J.
        deformation_work: work of loads and surfaces on the deformation of the body, J.
        damping: energy dissipated by damping, J.
        friction_heat: energy dissipated by friction, J.
        spring_energy: rise of the energy of the contact springs, J.
        own_work: deformation_work - damping - friction_heat - spring_energy, J.
        momentum: (2,) angular momentum at the start and at the end, kg m²/s.
        energy_rise: rise of the kinetic and elastic energy of the body, seen at rest, J.
        balance: shaft_work - contact_work - load_work + own_work - energy_rise, J: the imbalance of
            the time steps in the frame that stands still.
        critical: (mode, engine order, speed in rev/min) where an order that loads or waves excite
            meets a mode without contact, between the lowest and the highest speed.
    """

    time: Array
    speed: Array
    amplitude: Array
    peak_force: Array
    friction: Array
    torque: Array
    power: Array
    shaft_work: float
    contact_work: float
    load_work: float
    deformation_work: float
    damping: float
    friction_heat: float
    spring_energy: float
    own_work: float
    momentum: Array
    energy_rise: float
    balance: float
    critical: list[tuple[int, int, float]]


def run_up(stored: StoredModel, motion: Motion) -> RunUp | None:
    """Measure the motion of a model at a varying speed; None at a constant speed.

    Raises:
        ConvergenceError: there is no equilibrium at one of the speeds.
    """
    turning, whole = stored.model.turning, stored.whole
    if not turning.history.size or whole is None or motion.turning is None:
        return None
    time, steps = motion.time, np.diff(motion.time)
    omega, angle = (np.array([f(turning.history, t) for t in time]) for f in (speed_at, angle_at))
    momentum, inertia, by_loads = motion.turning.T
    by_contacts = _contact_moment(stored.model.points, stored.scene, motion)
    loads = steps * _middle(by_loads)
    contacts = steps * by_contacts
    impulse = np.diff(momentum) - loads - contacts
    works = _middle(omega) * np.array([impulse, -contacts, -loads])
    seen = np.asarray(motion.probe)[:, None] if stored.scene.joined else motion.displacement
    moved = seen - _at_rest(whole, omega, seen.shape)
    distance = np.linalg.norm(moved, axis=2).max(axis=1)
    force = motion.force[:, :, 0].max(axis=1, initial=0.0)
    rest = np.array([rest_energy(turning, speed) for speed in omega])
    turned = omega * momentum - 0.5 * omega**2 * turning.inertia
    rise = np.diff(motion.kinetic + motion.elastic + rest + turned).sum()
    # the work (4) of `online.model.turning`, with the mean of v . (g + G q/2)
    euler = np.sum(np.diff(omega) * _middle(momentum - omega * inertia))
    parametric = 0.5 * np.sum(np.diff(omega**2) * _middle(inertia - turning.inertia))
    spent = motion.damping_dissipation, motion.friction_dissipation, motion.contact_energy
    damping, friction, springs = (float(values[-1] - values[0]) for values in spent)
    by_speed = euler + parametric + rest[-1] - rest[0]
    deformed = motion.work[-1] - motion.work[0] + by_speed
    done = np.sum(np.diff(motion.work - sum(spent))) + by_speed

    turns = angle / (2.0 * np.pi)
    ends = np.arange(np.floor(turns[0]) + 1.0, np.floor(turns[-1] + 1e-9) + 1.0)
    rows = np.searchsorted(turns, ends - 1e-9)
    if not rows.size:  # less than a revolution
        rows = np.array([time.size - 1])
    first = np.concatenate([[0], rows[:-1]])
    lengths = time[rows] - time[first]

    def peaks(values: Array) -> Array:
        return np.array([values[i : j + 1].max() for i, j in zip(first, rows, strict=True)])

    return RunUp(
        time[rows],
        (angle[rows] - angle[first]) / lengths,
        peaks(distance),
        peaks(force),
        motion.friction_dissipation[rows] - motion.friction_dissipation[first],
        np.add.reduceat(impulse[: rows[-1]], first) / lengths,
        np.add.reduceat(works[0, : rows[-1]], first) / lengths,
        float(works[0].sum()),
        float(works[1].sum()),
        float(works[2].sum()),
        float(deformed),
        damping,
        friction,
        springs,
        float(done),
        momentum[[0, -1]],
        float(rise),
        float(works[0].sum() - works[1].sum() - works[2].sum() + done - rise),
        _critical(whole, stored.scene, omega.min(), omega.max()),
    )


def _critical(
    whole: RangeModel, scene: Scene, lowest: float, highest: float
) -> list[tuple[int, int, float]]:
    """`RunUp.critical` between two speeds in rad/s."""
    if lowest == highest:
        return []
    speeds, body = np.linspace(lowest, highest, SNAPSHOTS), RangeBody(whole, lowest)
    squares = np.empty((SNAPSHOTS, whole.modes))
    for row, speed in enumerate(speeds):
        body.spin(float(speed))
        squares[row] = modes_at_speed(body, whole.modes)[0] / (2.0 * np.pi) ** 2
    found = []
    for mode, column in enumerate(squares.T):
        curve = FrequencyCurve(30.0 / np.pi * speeds, column, coriolis=True)
        for order in excited_orders(scene):
            found += [(mode + 1, order, float(speed)) for speed in curve.crossings(order)]
    return sorted(found, key=lambda one: one[2])


def _middle(values: Array) -> Array:
    """The means (ns - 1,) of neighbours."""
    return 0.5 * (values[1:] + values[:-1])


def _at_rest(whole: RangeModel, omega: Array, shape: tuple[int, ...]) -> Array:
    """The displacements of this shape (ns, P, d) in the equilibria at some speeds (ns,), m."""
    model = whole.model
    rows, offset = model.contact_rows, model.contact_offset
    if not len(rows) or whole.contacts is not None:
        rows, offset = model.probe, model.probe_offset
    squares = np.unique(np.linspace(omega.min() ** 2, omega.max() ** 2, SNAPSHOTS))
    known = [offset + rows @ whole.equilibrium(float(speed)) for speed in np.sqrt(squares)]
    if squares.size == 1:
        found = np.repeat(known, omega.size, axis=0)
    else:
        from scipy.interpolate import CubicSpline  # slow to import

        found = CubicSpline(squares, known)(omega**2)
    return np.asarray(found.reshape(shape))


def _contact_moment(points: ContactPoints, scene: Scene, motion: Motion) -> Array:
    """The mean moment of the contacts on the body about the axis in each step (ns - 1,), N m.

    Bodies that touch push one another with equal forces, which have none.
    """
    d, rotation = points.position.shape[1], scene.rotation
    assert rotation is not None
    place = np.array(rotation.point or (0.0,) * d)
    x = 0.5 * (motion.displacement[1:] + motion.displacement[:-1])
    if not motion.force.shape[1]:
        return np.zeros(motion.time.size - 1)
    arm = points.position - place + np.einsum("npk,pkx->npx", x, points.frame)
    force = -np.einsum("npk,pkx->npx", motion.mean_force[1:], points.frame)
    force[:, paired(scene, points)] = 0.0
    if d == 2:
        along = arm[..., 0] * force[..., 1] - arm[..., 1] * force[..., 0]
    else:
        along = np.cross(arm, force) @ np.array(rotation.axis)
    return np.asarray(along.sum(axis=1))
