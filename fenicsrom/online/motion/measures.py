"""Numbers that are computed from a motion, and what it wore of abradable layers."""

import itertools
import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.notes import Note, NoteKind
from fenicsrom.online.contact.coating import Ring, rings_of
from fenicsrom.online.contact.points import ContactPoints, contacts_of
from fenicsrom.online.contact.surfaces import Contacts, penetration, surface_turn
from fenicsrom.online.kernels.compilation import kernel
from fenicsrom.online.model.loads import support_displacement
from fenicsrom.online.motion.motion import History, Motion
from fenicsrom.online.step.state import PeriodicSearch
from fenicsrom.scene import Scene

NO_MOTION = "must be a Motion, such as StoredModel.simulate returns"
STATE_NAMES = {-1: "open", 0: "slip", 1: "stick"}
# a motion is at rest if its amplitude, relative to the largest displacement, is smaller
REST = 1e-6
# amplitudes and dissipated energies count as zero in a comparison if they are smaller, relative to
# the whole amplitude and the largest energy: the rounding of a run is smaller still
NEGLIGIBLE = 1e-9
# amplitudes have settled if their relative change from period to period is smaller
SETTLED = 1e-3


def has_contact(motion: Motion) -> bool:
    """Whether a motion has contact points."""
    return motion.state.shape[1] > 0


def interpolated(motion: Motion, values: Array, times: Array) -> Array:
    """Values (ns, ...) of a motion at other times (k,), by linear interpolation: (k, columns)."""
    columns = values.reshape(motion.time.size, -1).T
    return np.array([np.interp(times, motion.time, column) for column in columns]).T


def times_before_end(motion: Motion, phases: Array) -> Array:
    """The times of some phases before the end of a motion, s.

    Args:
        motion: the motion.
        phases: (k,) parts of the last period, 0 at the end of the motion and 1 one period before;
            parts of the whole motion if it has no period.
    """
    length = motion.period or motion.time[-1] - motion.time[0]
    return np.asarray(motion.time[-1] - length * phases)


def out_of_reach(motion: Motion, points: ContactPoints) -> list[Note]:
    """A note on each contact with points that never touch, with their smallest gap."""
    found = []
    for k in np.unique(points.contact):
        mine = np.flatnonzero(points.contact == k)
        open_ones = mine[~np.any(motion.force[:, mine, 0] > 0.0, axis=0)]
        if open_ones.size:
            least = float(motion.gap[:, open_ones].min())
            number = "1 point" if mine.size == 1 else f"{open_ones.size} of {mine.size} points"
            text = f"{number} never touched the surface; the smallest gap was {1e3 * least:.4g} mm"
            found.append(Note(NoteKind.LEFT_OUT, text, f"contacts[{k}]"))
    return found


def amplitude(motion: Motion) -> Array:
    """Half of peak-to-peak over the last period, of each point and direction, (P d,), m."""
    return np.ptp(motion.displacement[motion.last_period()], axis=0).reshape(-1) / 2.0


def at_rest(motion: Motion) -> bool:
    """Whether a motion ends at rest: its amplitude is at most `REST` times its displacement."""
    largest = np.max(np.abs(motion.displacement), initial=0.0)
    return bool(np.linalg.norm(amplitude(motion)) <= REST * largest)


def has_settled(motion: Motion) -> bool:
    """Whether the amplitudes of a periodic motion repeat.

    The amplitudes repeat if the motion is steady, or if they agree to `SETTLED` in the last four
    periods. Weakly damped axial waves may persist, so that the motion is not steady, although the
    waves are too small to change the amplitudes.
    """
    if motion.steady or at_rest(motion):
        return True
    if motion.period is None:
        return False
    now, *before = period_amplitudes(motion, 4)
    apart = [float(np.linalg.norm(now - then)) for then in before]
    return len(apart) == 3 and max(apart) <= SETTLED * float(np.linalg.norm(now))


def period_amplitudes(motion: Motion, count: int) -> list[Array]:
    """Amplitudes (P d,) of the last periods of a motion, m, the last period first.

    Args:
        motion: a motion with a period.
        count: largest number of periods; a motion of fewer periods gives fewer.
    """
    assert motion.period is not None
    found, slack = [amplitude(motion)], 1e-9 * motion.period
    for back in range(1, min(count, motion.periods)):
        end = motion.time[-1] - back * motion.period
        begin = end - motion.period
        then = motion.displacement[(motion.time <= end + slack) & (motion.time >= begin - slack)]
        if then.size == 0:
            break
        found.append(np.ptp(then, axis=0).reshape(-1) / 2.0)
    return found


def is_unsteady(motion: Motion) -> bool:
    """Whether a motion has a period but does not settle."""
    return motion.period is not None and not has_settled(motion)


def rms(motion: Motion, since: float = 0.0, until: float = np.inf) -> Array:
    """Root mean square of a motion about its mean, of each point and direction, (P d,), m.

    Args:
        motion: the motion.
        since: start of the interval for a motion without period, s; the second half of a periodic
            motion is used.
        until: end of the motion, if it is not the end of the record, s.
    """
    until = min(until, float(motion.time[-1]))
    late = motion.time >= (since if motion.period is None else 0.5 * until)
    late &= motion.time <= until
    time, x = motion.time[late], motion.displacement[late].reshape(np.count_nonzero(late), -1)
    length = max(time[-1] - time[0], 1e-300)
    mean = np.trapezoid(x, time, axis=0) / length
    return np.asarray(np.sqrt(np.trapezoid((x - mean) ** 2, time, axis=0) / length))


def difference(motion: Motion, other: Motion) -> float:
    """Relative difference of two motions.

    It compares amplitudes if both motions have settled, and root mean squares otherwise.
    """
    if has_settled(motion) and has_settled(other):
        a, b = amplitude(motion), amplitude(other)
    else:
        a, b = rms(motion), rms(other)
    size = float(np.linalg.norm(b))
    return float(np.linalg.norm(a - b)) / size if size > 0.0 else float(np.linalg.norm(a) > 0.0)


def peak_normal_force(motion: Motion, since: float = 0.0) -> float:
    """Largest normal contact force of all points, N; 0 without contact.

    Args:
        motion: the motion.
        since: start of the interval for a motion without period, s; the last period of a periodic
            motion is used.
    """
    part = motion.last_period() if motion.period is not None else motion.time >= since
    return float(motion.force[part, :, 0].max(initial=0.0))


def amplitudes(motion: History) -> dict[str, Any]:
    """Half of peak-to-peak over the last period, at the first contact point.

    Args:
        motion: displacement in the contact frame; where there is no contact, at the probe in the
            global axes, and then the first axis counts as the normal direction.

    Raises:
        TypeError: the argument is no motion.

    Returns:
        The amplitudes in m: the number "normal", and under "tangential" a list with one number for
        each tangent direction.

    Example:
        >>> import fenicsrom as fr
        >>> motion = fr.load_model("out/beam.npz").simulate()
        >>> round(1e3 * fr.amplitudes(motion)["tangential"][0], 2)  # mm
        123.52
    """
    if not isinstance(motion, History):
        also = ", or a History of read_history"
        raise TypeError(f"amplitudes: {type(motion).__name__}: {NO_MOTION}{also}")
    half = np.ptp(motion.displacement[motion.last_period(), 0], axis=0) / 2
    return {"normal": float(half[0]), "tangential": [float(value) for value in half[1:]]}


def contact_fractions(motion: Motion) -> dict[str, float]:
    """Fractions of the last period in each contact state, averaged over the contact points.

    The trapezoidal rule weights the instants, because the steps may differ.

    Raises:
        TypeError: the argument is no motion.

    Returns:
        The fractions "open", "slip" and "stick", whose sum is 1; without contact "open" is 1.

    Example:
        >>> import fenicsrom as fr
        >>> motion = fr.load_model("out/beam.npz").simulate()
        >>> {state: round(part, 2) for state, part in fr.contact_fractions(motion).items()}
        {'open': 0.0, 'slip': 0.93, 'stick': 0.07}
    """
    if not isinstance(motion, Motion):
        raise TypeError(f"contact_fractions: {type(motion).__name__}: {NO_MOTION}")
    if not has_contact(motion):
        return {"open": 1.0, "slip": 0.0, "stick": 0.0}
    return {name: float(fractions.mean()) for name, fractions in _state_fractions(motion).items()}


def _state_fractions(motion: Motion) -> dict[str, Array]:
    """Fraction (P,) of the last period that each point spends in each state, by its name."""
    part = motion.last_period()
    weights = _weights(motion.time[part])
    return {name: weights @ (motion.state[part] == value) for value, name in STATE_NAMES.items()}


def peak_total_normal_force(motion: Motion) -> float:
    """Largest total normal force of all points over the last period, N; 0 without contact."""
    return float(motion.force[motion.last_period(), :, 0].sum(axis=1).max(initial=0.0))


def friction_dissipation_per_period(motion: Motion, since: float = 0.0) -> float:
    """Energy dissipated by friction in the last period, J; arguments as `peak_normal_force`."""
    begin = since if motion.period is None else motion.time[-1] - motion.period
    spent = motion.friction_dissipation
    return float(spent[-1] - np.interp(begin, motion.time, spent))


def point_summaries(motion: Motion) -> list[dict[str, Any]]:
    """Peak force, states and dissipation of each contact point.

    The numbers are those of the last period, or of the whole motion if it has no period.

    Returns:
        For each point `peak_normal_force_N`, `fraction` (as `contact_fractions`) and
        `friction_dissipation_per_period_J`.
    """
    part = motion.last_period()
    friction_dissipation = (
        motion.point_friction_dissipation[part][-1] - motion.point_friction_dissipation[part][0]
    )
    peaks, fractions = motion.force[part, :, 0].max(axis=0), _state_fractions(motion)
    return [
        {
            "peak_normal_force_N": float(peaks[p]),
            "fraction": {name: float(share[p]) for name, share in fractions.items()},
            "friction_dissipation_per_period_J": float(friction_dissipation[p]),
        }
        for p in range(motion.force.shape[1])
    ]


def response_summary(motion: Motion) -> dict[str, Any]:
    """The entry of a motion in `summary.json`.

    Returns:
        `amplitude_m` (of the first contact point), `fraction`, `peak_normal_force_N` (of any
        point), `peak_total_normal_force_N` (of all together), `friction_dissipation_per_period_J`,
        `energy_imbalance` (relative), `steady`, `periods`, `steps`, `newton_iterations`;
        and `periodic_motion` (see `search_summary`) where Newton's method has looked for it.
    """
    found = {
        "amplitude_m": amplitudes(motion),
        "fraction": contact_fractions(motion),
        "peak_normal_force_N": peak_normal_force(motion),
        "peak_total_normal_force_N": peak_total_normal_force(motion),
        "friction_dissipation_per_period_J": friction_dissipation_per_period(motion),
        "energy_imbalance": float(motion.relative_imbalance),
        "steady": bool(motion.steady),
        "periods": int(motion.periods),
        "steps": int(motion.steps),
        "newton_iterations": int(motion.newton_iterations),
    }
    if motion.search is not None:
        found["periodic_motion"] = search_summary(motion.search)
    return found


def search_summary(search: PeriodicSearch) -> dict[str, Any]:
    """What Newton's method found of the periodic motion, for `summary.json`.

    Returns:
        `verdict` ("stable", "unstable: fold", "unstable: period doubling", "unstable: torus",
        "wears" for a motion that wears an abradable layer and thus does not repeat, "not reached"
        for a stable motion to which the march does not tend, or "not found"),
        `from_s` (when the periodic motion replaced the marched one, or None), `load_periods` (in
        one period of the motion), `marched_periods`, `newton_iterations`, `relative_residual`,
        `largest_multiplier` (absolute value), `floquet_multipliers` (the largest, as pairs of real
        and imaginary part), `free_sliders` (components that are not unique; the multipliers are
        those without these), `at_yield` (only if true: the motion presses an abradable layer just
        to its yield stress, so the multipliers hold for motions that press it less),
        `relative_distance` (only if the march comes nearer to a stable motion without reaching it:
        how far it was).
    """
    multipliers = search.multipliers
    return {
        "verdict": search_verdict(search),
        "from_s": search.time,
        "load_periods": search.periods,
        "marched_periods": search.marched,
        "newton_iterations": search.iterations,
        "relative_residual": search.residual if math.isfinite(search.residual) else None,
        "largest_multiplier": float(abs(multipliers[0])) if multipliers.size else None,
        "floquet_multipliers": [[float(x.real), float(x.imag)] for x in multipliers],
        "free_sliders": search.free_sliders,
        **({"at_yield": True} if search.at_yield else {}),
        **({"relative_distance": search.away} if math.isfinite(search.away) else {}),
    }


def search_verdict(search: PeriodicSearch) -> str:
    """The verdict of `search_summary`."""
    if search.verdict in ("not found", "wears") or search.accepted:
        return search.verdict
    return "not reached" if search.verdict == "stable" else f"unstable: {search.verdict}"


def misses_motion(motion: Motion) -> bool:
    """Whether Newton's method found a stable periodic motion that the run has not reached."""
    search = motion.search
    return not motion.steady and search is not None and search_verdict(search) == "not reached"


def errors_percent(motion: Motion, reference: Motion) -> dict[str, float | None]:
    """Differences over the last period from a reference, in percent of the reference.

    Args:
        motion: the motion to compare.
        reference: the reference motion, usually of the full model.

    Returns:
        `{"amplitude_tangential": ..., "amplitude_normal": ..., "peak_normal_force": ...,
        "friction_dissipation_per_period": ...}`; tangential amplitudes are compared as a
        vector. None where the reference has no such motion, force or friction, and where both are
        `NEGLIGIBLE` relative to the whole amplitude or to the largest energy of the reference. A
        negligible reference of a larger value counts as the largest negligible one.
    """
    ours, theirs = amplitudes(motion), amplitudes(reference)
    pairs = list(itertools.zip_longest(ours["tangential"], theirs["tangential"], fillvalue=0.0))
    least = NEGLIGIBLE * math.hypot(theirs["normal"], *theirs["tangential"])

    def percent(difference: float, of: float, least: float = 0.0) -> float | None:
        if not of > 0.0 or (of <= least and abs(difference) <= least):
            return None
        return 100 * abs(difference) / max(of, least)

    force, friction = peak_normal_force(reference), friction_dissipation_per_period(reference)
    energy = NEGLIGIBLE * float(np.max(reference.kinetic + reference.elastic, initial=0.0))
    return {
        "amplitude_tangential": percent(
            math.hypot(*(a - b for a, b in pairs)), math.hypot(*theirs["tangential"]), least
        ),
        "amplitude_normal": percent(ours["normal"] - theirs["normal"], theirs["normal"], least),
        "peak_normal_force": percent(peak_normal_force(motion) - force, force),
        "friction_dissipation_per_period": percent(
            friction_dissipation_per_period(motion) - friction, friction, energy
        ),
    }


def _weights(time: Array) -> Array:
    """Weights (ns,) of the trapezoidal rule, with sum 1."""
    if len(time) < 2:
        return np.ones(len(time))
    steps = np.diff(time)
    return (np.append(steps, 0.0) + np.insert(steps, 0, 0.0)) / (2 * (time[-1] - time[0]))


def absolute_displacement(scene: Scene, points: ContactPoints, motion: Motion) -> Array:
    """The displacement of a motion plus that of the supports, in the frames of `displacement`."""
    moved = support_displacement(scene.loads, motion.time, scene.geometry.dimension)
    if len(points.contact):
        return np.asarray(motion.displacement + np.einsum("pij,kj->kpi", points.frame, moved))
    return np.asarray(motion.displacement + moved[:, None, : motion.displacement.shape[2]])


EVEN = 0.01  # smallest amplitude of the lobes, relative to the largest depth


class Wear(NamedTuple):
    """What a motion wore of one ring.

    Attributes:
        ring: the ring.
        depth: (cells,) worn depth at the nodes at the end of the motion, m.
        turned: angle by which the surface turned during the motion, as the body sees it, rad.
    """

    ring: Ring
    depth: Array
    turned: float

    @property
    def area(self) -> float:
        """The integral of the worn depth over the angle, m rad."""
        return float(np.mean(self.depth) * 2.0 * np.pi)

    @property
    def volume(self) -> float:
        """The worn volume, m^3."""
        return self.ring.volume(self.depth)

    @property
    def plastic_work(self) -> float:
        """The work that wore the layer, J, which comes from what turns the surface."""
        return self.ring.plastic_work(self.depth)

    @property
    def mean_torque(self) -> float:
        """The plastic work over the angle by which the surface turned, N m; 0 at rest."""
        return self.plastic_work / self.turned if self.turned else 0.0


def wear_of(motion: Motion, scene: Any, points: ContactPoints) -> list[Wear]:
    """What a motion wore of each ring; empty if no surface of the scene has an abradable layer.

    Args:
        motion: the motion.
        scene: its scene.
        points: the contact points.
    """
    if not scene.wears or motion.end is None or motion.end.worn is None:
        return []
    contacts, time, found = contacts_of(scene, points), float(motion.time[-1]), []
    for ring in rings_of(scene, points, contacts):
        turned = abs(surface_turn(contacts, ring.points[0], 0.0, time)) if ring.radius else 0.0
        found.append(Wear(ring, ring.depth(motion.end.worn), turned))
    return found


def worn_under_points(motion: Motion, contacts: Contacts) -> Array:
    """The worn depth (ns, P) of the layer in front of each point at each step, m.

    It is the gap to the worn surface less the gap to the new one, at most the whole layer.
    """
    found = motion.gap.copy()
    _add_depths(contacts, motion.time, motion.displacement, found)
    return np.clip(found, 0.0, contacts.coating.thickness)


@kernel
def _add_depths(contacts: Contacts, time: Array, x: Array, found: Array) -> None:
    """Add the depth of points at x (ns, P, d) below the new surface to `found` (ns, P)."""
    for row in range(time.size):
        for p in range(found.shape[1]):
            found[row, p] += penetration(contacts, p, x[row, p], time[row])


def worn_profile(rings: Sequence[Ring], worn: Array) -> tuple[Array, Array]:
    """Angles (c,) in rad around the axis, and the largest depth (c,) of all rings there, in m.

    Args:
        rings: the rings; those before a surface at rest have no angle and are left out.
        worn: (nodes,) worn depths.
    """
    turning = [ring for ring in rings if ring.radius]
    if not turning:
        return np.zeros(0), np.zeros(0)
    angle = max(turning, key=lambda ring: ring.cells).angle
    depths = [np.interp(angle, r.angle, r.depth(worn), period=2.0 * np.pi) for r in turning]
    return angle, np.max(depths, axis=0)


def lobes_of(depth: Array) -> int:
    """The number of lobes of a worn depth (c,) at equal angles: its largest harmonic; 0 if even."""
    if not depth.any():
        return 0
    amplitudes = 2.0 / depth.size * np.abs(np.fft.rfft(depth)[1:])
    if amplitudes.max() <= EVEN * depth.max():
        return 0
    return int(np.argmax(amplitudes)) + 1
