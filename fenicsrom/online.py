"""The online stage: from a scene and a reduced model to a motion, without mesh and without dolfinx.

A reduced model is stored in one `.npz` file with its labels, units, provenance and the scene it was made from. What the
online stage may change is the size of the loads that are not static and how they vary in time, the damping, everything
about the contacts but where they are, and the time integration.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fenicsrom.contact import ContactPoints, contacts_of
from fenicsrom.errors import AccuracyError, ConvergenceError, SceneError
from fenicsrom.files import read_archive, write_archive
from fenicsrom.integrate import Motion, end_of, integrate
from fenicsrom.reduced import ElasticPolynomial, ReducedModel, reduced_model
from fenicsrom.scene import Scene, override_table, parse_scene, scene_table
from fenicsrom.signals import Signals, of_loads

Array = NDArray[np.float64]

TIME_ERROR = 0.1  # estimated relative error by the time step above which a motion is refused
UNSETTLED_ERROR = 1.0  # the same of a motion that does not settle, whose root mean squares wander
PHASES = 200  # at which two periods are compared
BASIS_ERROR = 0.05  # relative difference from a basis with more derivatives above which a motion is refused
RESTS = 1e-6  # of the largest displacement: an amplitude below it is rest; steadiness is told no finer either
SETTLED = 1e-3  # relative change of the amplitudes from period to period below which they are taken as settled
ENERGY_ERROR = 1e-2  # relative imbalance of the energy ledger above which a motion is refused

FORMAT = "fenicsrom reduced model 2"
UNITS = {"mass": "kg", "stiffness": "N/m", "quadratic": "N/m^2", "cubic": "N/m^3", "force": "N", "frequencies_hz": "Hz"}


def signals(scene: Scene) -> Signals:
    """The time factors of a scene's loads."""
    return of_loads(scene.loads)


def simulate(
    model: Any,
    scene: Scene,
    *,
    start: Motion | None = None,
    **options: Any,
) -> Motion:
    """Integrate a model of a scene (reduced, full or beam) as its [time] table says.

    Args:
        model: the model.
        scene: the scene.
        start: a motion at whose end to start again from t = 0; else from rest in the equilibrium.
        options: `resume`, `keep_coordinates`, `progress` and `checkpoint` of `fenicsrom.integrate.integrate`.

    Raises:
        ConvergenceError, AccuracyError: see there.
    """
    return integrate(
        model,
        contacts_of(scene, model.points),
        scene.time,
        scene.period,
        dimension=scene.geometry.dimension,
        start=end_of(start) if start is not None else None,
        **options,
    )


def out_of_reach(motion: Motion, points: ContactPoints) -> list[str]:
    """A sentence on the points of each contact that touch nothing during the whole motion, with the gap that is left there."""
    sentences = []
    for k in np.unique(points.contact):
        mine = np.flatnonzero(points.contact == k)
        open_ones = mine[~np.any(motion.force[:, mine, 0] > 0.0, axis=0)]
        if open_ones.size:
            least = float(motion.gap[:, open_ones].min())
            number = "1 point" if mine.size == 1 else f"{open_ones.size} of {mine.size} points"
            sentences.append(f"contacts[{k}]: {number} out of reach during the whole run, no nearer than {1e3 * least:.4g} mm")
    return sentences


def amplitude(motion: Motion) -> Array:
    """Half of peak-to-peak over the last period, of each point and direction, (P d,), m."""
    return np.ptp(motion.displacement[motion.last_period()], axis=0).reshape(-1) / 2.0


def refined(scene: Scene, factor: int = 2) -> Scene:
    """The scene with its step divided (or its tolerance, by the factor to the power 3)."""
    time = scene.time
    if time.tolerance is not None:
        return replace(scene, time=replace(time, tolerance=time.tolerance / factor**3))
    if time.steps_per_period is not None:
        return replace(scene, time=replace(time, steps_per_period=time.steps_per_period * factor))
    assert time.step is not None
    return replace(scene, time=replace(time, step=time.step / factor))


def coarser(scene: Scene) -> Scene:
    """The scene with twice its step (at most its duration) or eight times its tolerance, more than a scene may ask for."""
    time = scene.time
    if time.tolerance is not None:
        return replace(scene, time=replace(time, tolerance=8.0 * time.tolerance))
    if time.steps_per_period is not None:
        return replace(scene, time=replace(time, steps_per_period=max(time.steps_per_period // 2, 2)))
    assert time.step is not None
    assert time.duration is not None
    return replace(scene, time=replace(time, step=min(2.0 * time.step, time.duration)))


def at_rest(motion: Motion) -> bool:
    """Whether a motion ends at rest: what still moves is `RESTS` of the displacement, or less."""
    return bool(np.linalg.norm(amplitude(motion)) <= RESTS * np.max(np.abs(motion.displacement), initial=0.0))


def settled(motion: Motion) -> bool:
    """Whether the amplitudes of a harmonic motion repeat: it is steady, or the last four agree to `SETTLED`.

    Axial waves that damping hardly reaches may ring on, too small for the amplitudes, and keep it from being steady.
    """
    if motion.steady or at_rest(motion):
        return True
    if motion.period is None:
        return False
    now, slack = amplitude(motion), 1e-9 * motion.period
    for back in range(1, 4):
        end = motion.time[-1] - back * motion.period
        then = motion.displacement[(motion.time <= end + slack) & (motion.time >= end - motion.period - slack)]
        if motion.periods < back + 1 or then.size == 0:
            return False
        if np.linalg.norm(now - np.ptp(then, axis=0).reshape(-1) / 2.0) > SETTLED * np.linalg.norm(now):
            return False
    return True


def wanders(motion: Motion) -> bool:
    """Whether a motion should repeat and does not settle."""
    return motion.period is not None and not settled(motion)


def spread(motion: Motion, since: float = 0.0) -> Array:
    """Root mean square of a motion about its mean, of each point and direction, (P d,), m.

    Over the second half of a motion that should repeat, else over all from a time on, s.
    """
    late = motion.time >= (since if motion.period is None else 0.5 * motion.time[-1])
    time, x = motion.time[late], motion.displacement[late].reshape(np.count_nonzero(late), -1)
    length = max(time[-1] - time[0], 1e-300)
    mean = np.trapezoid(x, time, axis=0) / length
    return np.asarray(np.sqrt(np.trapezoid((x - mean) ** 2, time, axis=0) / length))


def difference(motion: Motion, other: Motion) -> float:
    """Relative difference of two motions: of the amplitudes if both have settled, else of the root mean squares."""
    if settled(motion) and settled(other):
        a, b = amplitude(motion), amplitude(other)
    else:
        a, b = spread(motion), spread(other)
    size = float(np.linalg.norm(b))
    return float(np.linalg.norm(a - b)) / size if size > 0.0 else float(np.linalg.norm(a) > 0.0)


def peak_normal_force(motion: Motion, since: float = 0.0) -> float:
    """Largest normal contact force, N, of all points over the last period, else from a time on, s; 0 without contact."""
    part = motion.last_period() if motion.period is not None else motion.time >= since
    return float(motion.force[part, :, 0].max(initial=0.0))


class StepErrors(NamedTuple):
    """Estimates of relative errors by the time step.

    Attributes:
        amplitude: of the amplitudes of a motion that has settled, of the root mean squares of one that has not, or that has
            no period; infinite if no other motion could be had.
        peak_force: of the largest normal force; infinite too where the step does not resolve the contact.
    """

    amplitude: float
    peak_force: float


def step_errors(model: Any, scene: Scene, motion: Motion) -> StepErrors:
    """Estimate the errors of a motion by its time step, from a run with twice the step.

    Amplitudes are compared where both settle, else root mean squares: of a run of a duration, over what it recorded.
    They are twice the difference: six times the error of a scheme of second order, twice that of one of first order, to
    which the switching of contacts may bring it. Impacts make amplitudes jump to and fro as the step changes: that of the
    amplitudes is at least a third of the distance between the last periods. Peaks of the force that a stiff contact has
    within a few steps mean nothing: their error is unknown where the mean force leans half-way to the end of the step
    (`fenicsrom.contact.lean_to_the_end`).

    Args:
        model: that was integrated.
        scene: of the motion.
        motion: the motion.
    """
    coarse = coarser(scene)
    if coarse.time == scene.time and not at_rest(motion):  # a single step: there is none to compare with
        return StepErrors(np.inf, np.inf)
    try:
        other = simulate(model, coarse)
    except (ConvergenceError, AccuracyError):
        return StepErrors(np.inf, np.inf)
    if at_rest(motion) and at_rest(other):
        return StepErrors(0.0, 0.0)
    since = float(motion.time[0])  # what a resumed run recorded
    peak, resolved = peak_normal_force(motion), motion.end is None or np.all(motion.end.state.trial.room.lean < 0.5)
    apart = 2.0 * abs(peak - peak_normal_force(other, since))
    force = 0.0 if peak == apart == 0.0 else apart / peak if resolved and peak > 0.0 else np.inf
    if not settled(motion):
        ours, theirs = spread(motion), spread(other, since)
        size, apart = float(np.linalg.norm(ours)), float(np.linalg.norm(ours - theirs))
        return StepErrors(2.0 * apart / size if size > 0.0 else 0.0, force)
    if not settled(other):
        return StepErrors(np.inf, force)
    size = float(np.linalg.norm(amplitude(motion)))
    apart = 2.0 * float(np.linalg.norm(amplitude(motion) - amplitude(other)))
    shape, other_shape = _last_period(motion), _last_period(other)
    distance = float(np.linalg.norm(shape - other_shape))
    shape_size = float(np.linalg.norm(shape - shape.mean(axis=0)))
    return StepErrors(max(apart / size, distance / (3.0 * shape_size)) if size > 0.0 else 0.0, force)


def _last_period(motion: Motion) -> Array:
    """Displacements (`PHASES`, P d) at equal phases of the last period, m."""
    assert motion.period is not None
    part = motion.last_period()
    phases = motion.time[-1] - motion.period * np.arange(PHASES) / PHASES
    columns = motion.displacement[part].reshape(-1, motion.displacement[0].size).T
    return np.array([np.interp(phases, motion.time[part], column) for column in columns]).T


def check_time_error(scene: Scene, estimate: float, wandering: bool = False) -> None:
    """Refuse a motion whose estimated error by the time step is above `TIME_ERROR`; `UNSETTLED_ERROR` if it wanders.

    Raises:
        AccuracyError: it is.
    """
    allowed = UNSETTLED_ERROR if wandering else TIME_ERROR
    if estimate <= allowed:
        return
    time = scene.time
    name = next(name for name in ("tolerance", "steps_per_period", "step") if getattr(time, name) is not None)
    other = "eight times the tolerance" if name == "tolerance" else "twice the step"
    size = f"an error of about {100.0 * estimate:.2g} %" if np.isfinite(estimate) else "no motion that settles, or none"
    raise AccuracyError(
        f"time.{name} = {getattr(time, name):g}: the steps are too long: {other} gives {size} "
        f"(at most {100.0 * allowed:g} % is taken as converged{', of a motion that does not settle' if wandering else ''}): "
        f"a richer basis is no help, {name} = {getattr(enough(scene, estimate).time, name):g} is likely enough"
        f"{'' if np.isfinite(estimate) else other_scheme(scene)}"
    )


def other_scheme(scene: Scene) -> str:
    """What to try where a motion does not settle: the end of a sentence."""
    conserves = scene.time.scheme == "discrete-gradient"
    return '; or time.scheme = "generalised-alpha", which damps the waves that the steps do not resolve' if conserves else ""


def enough(scene: Scene, estimate: float) -> Scene:
    """The scene with its step halved until an error by the time step is likely below half of `TIME_ERROR`.

    The error is taken to fall with the step as in a scheme of first order, to which contacts that switch may bring it; where
    no estimate could be made (infinite), a quarter of the step is taken.
    """
    halvings = np.log2(estimate / (0.5 * TIME_ERROR)) if np.isfinite(estimate) else 2.0
    return refined(scene, 2 ** max(1, int(np.ceil(halvings))))


def check_basis_error(scene: Scene, estimate: float) -> None:
    """Refuse a motion whose estimated error by the basis is above `BASIS_ERROR`.

    Raises:
        AccuracyError: it is.
    """
    if estimate <= BASIS_ERROR:
        return
    size = f"amplitudes that differ by {100.0 * estimate:.2g} %" if np.isfinite(estimate) else "no motion that settles"
    raise AccuracyError(
        f"the basis is too poor: with more modes or derivatives it gives {size} (at most {100.0 * BASIS_ERROR:g} % is "
        "taken as converged): lower basis.threshold, or take derivatives = 'all' or more than basis.modes = "
        f"{scene.basis.modes}"
    )


def check_energy(motion: Motion) -> None:
    """Refuse a motion whose energy ledger is off by more than `ENERGY_ERROR`, or in which friction gives energy.

    Energy from nowhere is held against the largest energy of the motion, as it may come to be all of it. Energy that is lost
    (it is what generalised-alpha is made for) is held against the largest energy and the work of the loads together: it is
    so much more damping.

    Raises:
        AccuracyError: it is.
    """
    energy = float(np.max(motion.kinetic + np.abs(motion.elastic)))
    work = float(np.max(np.abs(motion.work - motion.work[0])))
    both = "largest energy and the work of the loads"
    for sign, share, found in ((1.0, energy, "largest energy"), (-1.0, energy + work, both)):
        off = float(np.max(sign * motion.imbalance))
        if not off <= ENERGY_ERROR * share:
            kind = "comes from nowhere" if sign > 0.0 else "is lost"
            raise AccuracyError(
                f"the energy ledger is off: {off / share if share > 0.0 else np.inf:.1e} of the {found} {kind} "
                f"(at most {ENERGY_ERROR:g} is allowed): the steps are too long for the scheme"
            )
    gains = np.diff(motion.rubbed)
    given, taken = -float(np.sum(gains[gains < 0.0])), float(np.sum(gains[gains > 0.0]) + motion.damped[-1] - motion.damped[0])
    if given > ENERGY_ERROR * taken:
        part = f"{given / taken:.1e} of what is dissipated" if taken > 0.0 else "from nothing"
        raise AccuracyError(
            f"friction gives energy to the motion, {part} (at most {ENERGY_ERROR:g} is allowed): the steps are too "
            "long for the stiffness of the contact"
        )


def doubt(model: Any, scene: Scene, motion: Motion) -> AccuracyError | None:
    """Why a motion is not to be relied on, as far as the model alone can tell; None if nothing speaks against it."""
    try:
        check_energy(motion)
        check_time_error(scene, step_errors(model, scene, motion).amplitude, wanders(motion))
    except AccuracyError as error:
        return error
    return None


@dataclass(frozen=True, eq=False)
class StoredModel:
    """A reduced model as a file holds it.

    Attributes:
        model: the model.
        scene: the scene it was made from.
        method: "rubin" or "craig-bampton".
        labels: (n,) of its coordinates.
        dofs: number of free unknowns of the solid.
        frequencies_hz: (v,) of the normal modes.
        provenance: versions of the programs that made it, by name.
    """

    model: ReducedModel
    scene: Scene
    method: str
    labels: tuple[str, ...]
    dofs: int
    frequencies_hz: Array
    provenance: dict[str, str]

    @property
    def size(self) -> int:
        """Number of coordinates."""
        return self.model.size


def provenance(modules: Sequence[str] = ("numpy", "numba", "fenics-dolfinx", "petsc4py", "slepc4py")) -> dict[str, str]:
    """Versions of this program and of what it stands on, where they are installed."""
    found = {}
    for name in ("fenicsrom", *modules):
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found


def save_model(path: Path, stored: StoredModel) -> None:
    """Write a reduced model; the file appears whole or not at all.

    Raises:
        OSError: it cannot be written.
    """
    header = {
        "format": FORMAT,
        "method": stored.method,
        "labels": list(stored.labels),
        "dofs": stored.dofs,
        "source": stored.scene.source,
        "scene": scene_table(stored.scene),
        "units": UNITS,
        "provenance": stored.provenance,
    }
    model = stored.model
    arrays = {
        "frequencies_hz": stored.frequencies_hz,
        "mass": model.mass,
        "damping": np.array(model.damping),
        **model.elastic._asdict(),
        "loads": model.loads,
        **{f"point_{name}": array for name, array in model.points._asdict().items()},
        "contact_rows": model.contact_rows,
        "contact_offset": model.contact_offset,
        "probe": model.probe,
        "probe_offset": model.probe_offset,
        "turning": model.turning,
    }
    write_archive(path, header, arrays)


def load_model(path: Path) -> StoredModel:
    """Read a reduced model.

    Raises:
        SceneError: the file is missing, damaged, of another format, or its arrays do not fit together.
    """
    with read_archive(path, "a reduced model", FORMAT) as (header, data):
        scene = parse_scene(header["scene"], str(header["source"]), None)
        labels = tuple(str(label) for label in header["labels"])
        return _assemble(path, data, header, scene, labels)


def _assemble(path: Path, data: dict[str, Any], header: dict[str, Any], scene: Scene, labels: tuple[str, ...]) -> StoredModel:
    n, d = len(labels), scene.geometry.dimension
    p = n * (n + 1) // 2 if scene.geometrically_nonlinear else 0
    belongs = data["point_contact"]
    if belongs.ndim != 1 or belongs.dtype != np.int64 or not np.array_equal(np.unique(belongs), np.arange(len(scene.contacts))):
        raise SceneError(f"{path}: point_contact does not name the contacts of the scene: the file is damaged")
    points = belongs.size
    shapes = {
        "mass": (n, n),
        "damping": (),
        "force": (n,),
        "stiffness": (n, n),
        "quadratic": (p, n if p else 0),
        "cubic": (p, p),
        "loads": (n, len(scene.loads)),
        "point_share": (points,),
        "point_position": (points, d),
        "point_frame": (points, d, d),
        "contact_rows": (points * d, n),
        "contact_offset": (points * d,),
        "probe": (d, n),
        "probe_offset": (d,),
        "turning": (n, n) if scene.rotation is not None and scene.rotation.coriolis else (0, 0),
        "frequencies_hz": (data["frequencies_hz"].size,),
    }
    for name, shape in shapes.items():
        array = data[name]
        if array.shape != shape or array.dtype != np.float64 or not np.all(np.isfinite(array)):
            raise SceneError(f"{path}: {name} has shape {array.shape} and type {array.dtype}: must be {shape} of finite float64")
    for name in ("mass", "stiffness"):
        if np.max(np.abs(data[name] - data[name].T), initial=0.0) > 1e-9 * np.max(np.abs(data[name]), initial=0.0):
            raise SceneError(f"{path}: {name} is not symmetric: the file is damaged")
    turning = data["turning"]
    if np.max(np.abs(turning + turning.T), initial=0.0) > 1e-9 * np.max(np.abs(turning), initial=0.0):
        raise SceneError(f"{path}: turning is not skew: the file is damaged")
    if not (np.all(np.linalg.eigvalsh(data["mass"]) > 0.0) and data["damping"] >= 0.0):
        raise SceneError(f"{path}: mass or damping is not positive: the file is damaged")
    elastic = ElasticPolynomial(*(data[name] for name in ElasticPolynomial._fields))
    model = reduced_model(
        data["mass"], float(data["damping"]), elastic, data["loads"], signals(scene),
        ContactPoints(*(data[f"point_{name}"] for name in ContactPoints._fields)), data["contact_rows"],
        data["contact_offset"], data["probe"], data["probe_offset"], data["turning"],
    )  # fmt: skip
    made_by = {str(k): str(v) for k, v in header["provenance"].items()}
    return StoredModel(model, scene, str(header["method"]), labels, int(header["dofs"]), data["frequencies_hz"], made_by)


def rescene(stored: StoredModel, overrides: Sequence[str]) -> tuple[ReducedModel, Scene]:
    """The stored model under another load, frequency, friction, damping or time integration.

    Args:
        stored: the model.
        overrides: as for `fenicsrom.scene.read_scene`, such as "loads.0.force=200".

    Returns:
        The model with its new time factors, and the new scene.

    Raises:
        SceneError: an override is wrong, or changes what the model was built from.
    """
    table = scene_table(stored.scene)
    named = {override.partition("=")[0].strip() for override in overrides}
    for given, other in (("time.tolerance", "steps_per_period"), ("time.steps_per_period", "tolerance")):
        if given in named:  # the table holds every default; one of the two excludes the other
            table["time"] = {key: value for key, value in table["time"].items() if key != other}
    scene = parse_scene(override_table(table, overrides, stored.scene.source), stored.scene.source, None)
    if (key := changed_key(stored.scene, scene)) is not None:
        raise SceneError(f"{scene.source}: {key} cannot change on a stored reduced model: run the scene again")
    return with_scene(stored, scene)


def with_scene(stored: StoredModel, scene: Scene) -> tuple[ReducedModel, Scene]:
    """The stored model with the time factors and damping of a scene that agrees with its own (`changed_key` is None)."""
    return stored.model._replace(signals=signals(scene), damping=float(scene.material.mass_damping)), scene


def changed_key(made: Scene, wanted: Scene) -> str | None:
    """The first key of the offline stage in which two scenes differ, None if they agree."""
    for name in ("geometrically_nonlinear", "geometry", "supports", "rotation", "probe", "basis"):
        if getattr(made, name) != getattr(wanted, name):
            return name
    if replace(made.material, mass_damping=0.0) != replace(wanted.material, mass_damping=0.0):
        return "material"
    for kind in ("loads", "contacts"):
        ours, theirs = getattr(made, kind), getattr(wanted, kind)
        if len(ours) != len(theirs):
            return kind
        for k, (a, b) in enumerate(zip(ours, theirs, strict=True)):
            if a.place != b.place:
                return f"{kind}[{k}].place"
            if kind == "contacts" and a.normal != b.normal:
                return f"contacts[{k}].normal"
            if kind == "contacts" and a.surface is not None:
                for name in ("kind", "point", "axis", "inside"):  # the frames of the points are those of its normals
                    if getattr(a.surface, name) != getattr(b.surface, name):
                        return f"contacts[{k}].surface.{name}"
            if kind == "loads" and a.direction != b.direction:
                return f"loads[{k}].direction"
            if kind == "loads" and a.kind != b.kind:
                return f"loads[{k}].{b.kind}"
            if kind == "loads" and (a.static or b.static) and a != b:
                return f"loads[{k}]: a static load"
    return None
