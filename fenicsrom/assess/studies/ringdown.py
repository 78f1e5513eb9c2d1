"""Ring-downs: the free decay of a reduced model that is let go from a static load.

The loads that vary in time are held at their sizes and let go at t = 0. The load grows in steps of
`LONG` periods, in which generalised-alpha with a spectral radius of 0 (Chung and Hulbert 1993) is
an implicit method without inertia and damping: friction acts along the path of the load. Of bodies
that touch, contacts alone may hold a piece, which only its mass holds in a trial step: their steps
are a fifth of a period, and numerical damping stills them.

With the shape phi of a linear mode (phi . M phi = 1) and the rest q0, the modal coordinate
eta(t) = phi . M [q(t) - q0] turns at the times t_j, between which it swings by
s_j = |eta(t_j+1) - eta(t_j)|. The period from t_j to t_j+2 has

    f = 1/(t_j+2 - t_j),  A = (s_j + s_j+1)/4,  zeta = L/sqrt(pi^2 + L^2),  L = ln(s_j/s_j+2)/2 (1)

which is exact for a linear oscillator. Swings do not need the place where friction lets it stop.
"""

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.assess.curves.backbone import STILL, change_notes, linear_mode
from fenicsrom.assess.curves.results import CurveRecord, require_polynomial
from fenicsrom.assess.errors.shortening import shortening_notes
from fenicsrom.assess.studies.batch import Batch
from fenicsrom.assess.studies.sweep_runs import digest_of
from fenicsrom.errors import ConvergenceError, ErrorKind, job_error, refuse
from fenicsrom.notes import DAMPING_RATIOS, Note, NoteKind, packed, unpacked
from fenicsrom.online.curves.nonlinear_mode import LinearMode
from fenicsrom.online.model.model import Problem
from fenicsrom.online.motion.motion import Motion
from fenicsrom.online.periodic.shooting import FALLBACK_STEPS
from fenicsrom.online.run.march import end_of
from fenicsrom.online.run.simulate import simulate
from fenicsrom.online.store.archive import StoredModel
from fenicsrom.online.store.store import fingerprint
from fenicsrom.progress import working_time
from fenicsrom.scene import Scene, Time
from fenicsrom.scene.keys.loads import with_rows
from fenicsrom.scene.reading.reading import refined
from fenicsrom.words import brief

RAMP, REST = 50, 10  # steps in which the load grows, and in which the body comes to rest
LONG = 1e4  # length of these steps, periods of the mode
JOINT_RAMP, JOINT_REST, JOINT_LONG = 250, 100, 0.2  # those of bodies that touch
NODES = 7  # samples of the polynomial through a turning point
TURN = 0.02  # a smaller part of a swing does not turn it: the motion of another mode

VARIANTS = {
    "the decay": "",
    "half the time step": "time.steps_per_period",
    "all coordinates of the model": "basis.size",
}
"""What is computed, and the key that makes it better."""


@dataclass(frozen=True)
class Period:
    """One period by (1), with energies in J; the amplitude is that of the probe in the mode."""

    number: int
    linear_amplitude: float
    frequency: float
    damping_ratio: float
    friction_dissipation: float
    damping_dissipation: float


@brief()
@dataclass(eq=False, repr=False)
class Ringdown(CurveRecord):
    """The ring-down of a scene.

    Attributes:
        mode: the linear mode.
        direction: direction of the probe's largest motion in it.
        periods: the periods of the decay.
        curve: (2, ns) times, s, and displacements of the probe in the mode, m.
        changes: the largest changes of the frequency (relative) and of the damping ratio, by the
            names of `VARIANTS`.
    """

    mode: LinearMode
    direction: int
    periods: list[Period] = field(default_factory=list)
    curve: Array = field(default_factory=lambda: np.zeros((2, 0)))
    changes: dict[str, dict[str, float]] = field(default_factory=dict)


def check_ringdown(scene: Scene) -> None:
    """Check before the offline stage that the ring-down of a scene can be computed.

    Raises:
        SceneError: no load varies, the force is projected, or something drives the released body.
    """
    if not any(load.size and not load.static for load in scene.loads):
        reason = "a ring-down needs a load that varies in time; it is held, and let go at t = 0"
        raise refuse(scene.source, reason, ErrorKind.MISSING, "loads")
    require_polynomial(scene, "a ring-down")
    if scene.basis.masters == "motion":
        reason = 'must be "all" in a ring-down: the motion of the scene, which would choose the '
        reason += "interface vectors, is another one"
        raise refuse(scene.source, reason, ErrorKind.CONFLICT, "basis.masters")
    parts: list[tuple[str, object, tuple[str, str]]] = [
        ("rotation", scene.rotation, ("history", "coriolis"))
    ]
    for k, contact in enumerate(scene.contacts):
        parts.append((f"contacts[{k}]", contact, ("approach", "abradable")))
        parts.append((f"contacts[{k}].surface", contact.surface, ("spin", "waves")))
    for table, part, names in parts:
        for name in (name for name in names if getattr(part, name, None)):
            reason = "not allowed in a ring-down, the motion of one mode that nothing drives"
            raise refuse(scene.source, reason, ErrorKind.CONFLICT, f"{table}.{name}")


def ringdown(stored: StoredModel, folder: Path | None = None, **how: Any) -> Ringdown:
    """Compute the ring-down of a model under its scene, with half the step and all coordinates.

    The folder keeps decays that are done. Other arguments and errors as `Batch` and `linear_mode`.
    """
    check_ringdown(stored.scene)
    begin, scene = working_time(), stored.scene
    mode, direction, _ = linear_mode(stored, Problem.of(stored.model, scene), "ringdown")
    found = Ringdown(scene, stored.size, stored.model.points, mode, direction)
    whole = stored.resized((*stored.labels, *stored.further))
    jobs = [(stored, 1.0), (stored, 2.0), (whole, 1.0)][: 3 if stored.further else 2]
    digests = [f"{digest_of(scene, fingerprint(one.model))} {k}" for one, k in jobs]
    names, batch = list(VARIANTS), Batch("decay", folder, {"Period": Period}, **how)
    done = batch.each(_decay, jobs, lambda k, _: names[k], digests)
    found.interrupted = batch.interrupted
    for name, one in ((names[k], done[k]) for k in sorted(done)):
        if isinstance(one, Exception):
            found.unfinished = found.unfinished or job_error(one)
            found.warnings.append(Note(NoteKind.FAILED, f"{name}: {one}"))
        elif not (key := VARIANTS[name]):
            found.periods, found.curve, notes = one
            found.warnings += unpacked(notes)
        elif pairs := list(zip(found.periods, one[0], strict=False)):
            frequency = max(abs(better.frequency / p.frequency - 1.0) for p, better in pairs)
            ratio = max(abs(better.damping_ratio - p.damping_ratio) for p, better in pairs)
            found.changes[name] = {"frequency_relative": frequency, "damping_ratio": ratio}
            damping = max(abs(p.damping_ratio) for p in found.periods)
            found.warnings += change_notes(name, key, frequency, ratio, damping)
    found.seconds = working_time() - begin
    return found


def _decay(job: tuple[StoredModel, float]) -> tuple[list[Period], Array, list[list[str]]]:
    """Periods, curve and notes of a model, its step divided by a factor; errors as `ringdown`."""
    (stored, shorter), scene, model = job, job[0].scene, job[0].model
    table, settings = scene.ringdown, scene.time
    mode, _, unit = linear_mode(stored, Problem.of(model, scene), "ringdown")
    length = 2.0 * np.pi / mode.omega
    joint = JOINT_RAMP, JOINT_REST, JOINT_LONG
    ramp, rest, steps = joint if scene.joined else (RAMP, REST, LONG)
    long, grown = steps * length, ramp * steps * length
    slow = {"scheme": "generalised-alpha", "spectral_radius": 0.0, "duration": grown + rest * long}
    held = _loaded(scene, Time.of(**slow, step=long), (0.0, 0.0), (grown, table.factor))
    q, v, sliders = end_of(simulate(stored, held))
    shape = mode.shape.real / np.sqrt(mode.shape.real @ model.mass @ mode.shape.real)
    moved = q - mode.equilibrium
    if abs(shape @ model.mass @ moved) <= STILL * np.sqrt(moved @ model.mass @ moved):
        raise ConvergenceError(
            f"the loads do not move mode {table.mode}; choose another ringdown.mode or other loads"
        )
    step = settings.step or length / (settings.steps_per_period or FALLBACK_STEPS)
    stepping = {"tolerance": settings.tolerance} if settings.tolerance else {"step": step}
    time = settings.changed(duration=table.periods * length, **stepping)
    free = refined(_loaded(scene, time, (0.0, 0.0), (1.0, 0.0)), shorter)
    motion = simulate(stored, free, start=(q, 0.0 * v, sliders), keep_coordinates=True)
    assert motion.coordinates is not None
    moved = unit * ((motion.coordinates - mode.equilibrium) @ (model.mass @ shape))
    periods = periods_of(motion, moved)
    if not periods:
        raise ConvergenceError("the decay has no period: it is damped too much, or friction holds")
    least = table.smallest * periods[0].linear_amplitude
    kept = [p for p in periods if p.linear_amplitude >= least]
    notes = shortening_notes(stored, motion, quantity=DAMPING_RATIOS)
    return kept, np.array([motion.time, moved]), packed(notes)


def _loaded(scene: Scene, time: Time, *rows: tuple[float, float]) -> Scene:
    """The scene with these rows (time in s, factor) as the history of the loads that vary."""
    loads = (load if load.static else with_rows(load, rows) for load in scene.loads)
    return replace(scene, loads=tuple(loads), time=time)


def periods_of(motion: Motion, moved: Array) -> list[Period]:
    """The periods (1) of a motion whose modal coordinate moves the probe by `moved` (ns,), m."""
    (times, values), found = turning_points(motion.time, moved), list[Period]()
    swings = np.abs(np.diff(values))
    lost = motion.friction_dissipation, motion.damping_dissipation
    for j in range(0, times.size - 3, 2):
        begin, end, (one, two, three) = times[j], times[j + 2], swings[j : j + 3]
        friction, damping = (np.diff(np.interp([begin, end], motion.time, e))[0] for e in lost)
        log = 0.5 * np.log(one / three)
        found.append(
            Period(
                number=len(found) + 1,
                linear_amplitude=float((one + two) / 4.0),
                frequency=float(1.0 / (end - begin)),
                damping_ratio=float(log / np.hypot(np.pi, log)),
                friction_dissipation=float(friction),
                damping_dissipation=float(damping),
            )
        )
    return found


def turning_points(time: Array, values: Array) -> Array:
    """The first time and value (ns,), and those where polynomials through the values turn."""
    kept, best = [0], 0
    for k in range(values.size):
        swing = abs(values[best] - values[kept[-1]])
        if abs(values[k] - values[kept[-1]]) >= swing:
            best = k
        elif abs(values[k] - values[best]) > TURN * swing:
            kept.append(best)
            best = k
    found = [(time[0], values[0])]
    for k in kept[1:]:
        near = np.arange(NODES) + np.clip(k - NODES // 2, 0, time.size - NODES)
        curve = np.polynomial.Polynomial.fit(time[near], values[near], NODES - 1)
        roots = curve.deriv().roots()
        at = roots[np.argmin(np.abs(roots - time[k]))].real
        found.append((at, curve(at)))
    return np.array(found, dtype=np.float64).T
