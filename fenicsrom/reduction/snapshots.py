"""Deflections of the structure (snapshots) that select modes and derivatives.

Two sets of snapshots (Mashayekhi and Zucca 2024, sec. 2.2): U_t of a geometrically linear transient
with friction, and U_st of nonlinear statics under the force of eq. (18).

A response curve over the frequency moves the body at other frequencies too. U_t then has more
transients: at both ends of the curve, and where a load or one of its harmonics meets a natural
frequency. A linear resonance is too large and would hide the other snapshots. Therefore none of
these transients has more weight than the transient of the scene.

A backbone moves the body along one mode, often farther than the loads do. The linear mode at the
largest amplitude of the backbone therefore joins the snapshots of derivatives along principal
directions.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.errors import AccuracyError, ConvergenceError, ErrorKind
from fenicsrom.notes import Note, NoteKind
from fenicsrom.online.curves.nonlinear_mode import linear_modes
from fenicsrom.online.model.loads import OMEGA
from fenicsrom.online.model.model import Problem, ReducedModel
from fenicsrom.online.model.pencil import roots
from fenicsrom.online.motion.motion import Motion
from fenicsrom.online.periodic.shooting import frequency_family
from fenicsrom.online.run.march import integrate
from fenicsrom.online.run.simulate import checked_problem
from fenicsrom.online.step.state import Checkpoint
from fenicsrom.progress import tracked
from fenicsrom.reduction.basis import build_basis, project
from fenicsrom.reduction.modes import ComponentModes
from fenicsrom.reduction.protocols import Structure
from fenicsrom.scene import Scene, Time

SNAPSHOTS = 200
"""Largest number of snapshots of the linear transient."""

RESOLVED = 10
"""Snapshots in a period of the excitation that resolve it."""

STATIC_LEVELS = 10
"""Number of load levels of the nonlinear statics."""

STATIC_ACCURACY = 1e-7
"""Relative error of the nonlinear statics.

The extrapolation to the next level amplifies errors; a looser tolerance costs factorisations.
"""

SNAPSHOT_STEADINESS = 1e-3
"""The linear transient ends if its relative change over a period is smaller."""

SNAPSHOT_PERIODS = 200
"""Largest number of periods of the linear transient.

The number does not depend on `time.periods`: a run that continues with more periods has the same
basis.
"""


PIECE = 5
"""Periods of the linear transient whose rows are held together."""

UNBOUNDED = 1e6
"""A free vibration that grows by this factor hides the forced motion from the selection."""

MOST_RESONANCES = 6
"""Largest number of resonances of a response curve at which linear transients are computed."""

MODE_PHASES = 40
"""Snapshots of a period of the mode of a backbone."""


@dataclass(frozen=True, eq=False)
class Deflections:
    """Deflections U = V C of a structure, from the equilibrium, m.

    Attributes:
        vectors: (local, n) V.
        coordinates: (n, s) C.
    """

    vectors: Array
    coordinates: Array


class Snapshots:
    """The snapshots of a structure; each set is computed when it is first read."""

    def __init__(self, structure: Structure, scene: Scene, modes: ComponentModes):
        """Store the arguments.

        Args:
            structure: the structure.
            scene: its contacts and time integration define the linear transient.
            modes: component modes of the structure.
        """
        self._structure, self._scene, self._modes = structure, scene, modes

    @cached_property
    def linear(self) -> Deflections:
        """U_t: snapshots of the linear transients."""
        largest = self._sizes(self._own).max(initial=0.0)
        found = [self._own]
        for frequency in curve_frequencies(self._structure, self._scene, self._modes):
            try:
                more = linear_snapshots(self._structure, self._scene, self._model, frequency)
            except (AccuracyError, ConvergenceError) as error:
                text = f"the selection of derivatives leaves out {frequency:.5g} Hz: {error}"
                self._structure.warnings.append(Note(NoteKind.WARNING, text))
                continue
            size = self._sizes(more).max(initial=0.0)
            found.append(more * min(1.0, largest / size) if size > 0.0 else more)
        return Deflections(self._model.vectors, np.concatenate(found, axis=1))

    @cached_property
    def mode(self) -> Array:
        """Coordinates (n, s) of the mode of a backbone, in the vectors of `linear`."""
        return mode_snapshots(self._scene, self._model.model)

    @cached_property
    def static(self) -> Array:
        """U_st (local, `STATIC_LEVELS`): snapshots of the nonlinear statics, m.

        Where motions choose the interface vectors, those of the first basis serve all bases: the
        vectors change the deflections at the contacts alone.
        """
        if self._structure.deflections is not None:
            return self._structure.deflections
        largest = int(np.argmax(self._sizes(self._own)))
        found = static_snapshots(self._structure, self._model.vectors @ self._own[:, largest])
        if self._scene.basis.masters == "motion":
            self._structure.deflections = found
        return found

    @cached_property
    def _model(self) -> LinearModel:
        """The linear model of all transients."""
        return linear_model(self._structure, self._modes)

    @cached_property
    def _own(self) -> Array:
        """Coordinates (n, s) of the linear transient of the scene; zero if nothing moves it."""
        if _rests(self._scene):
            return np.zeros((self._model.vectors.shape[1], 1))
        return linear_snapshots(self._structure, self._scene, self._model)

    def _sizes(self, coordinates: Array) -> Array:
        """Size (s,) of each column of coordinates (n, s), by its mass."""
        inertia = self._model.model.mass @ coordinates
        return np.sqrt(np.maximum(np.sum(coordinates * inertia, axis=0), 0.0))


def _rests(scene: Scene) -> bool:
    """Whether bodies that touch stay at rest, up to the rounding of the forces that press them."""
    moved = any(contact.approach or contact.surface for contact in scene.contacts)
    turned = scene.rotation is not None and bool(scene.rotation.history)
    still = all(load.static for load in scene.loads)
    return scene.joined and still and not moved and not turned


def curve_frequencies(structure: Structure, scene: Scene, modes: ComponentModes) -> list[float]:
    """The frequencies, in Hz, at which a response curve needs more linear transients.

    These are the two ends of a curve over the frequency, and between them the lowest frequencies
    of the loads at which a sine of a load meets a natural frequency. Without such a curve there
    are none.
    """
    response = scene.response
    if response is None or response.parameter != "frequency" or scene.period is None:
        return []
    orders = structure.load_histories.sines[:, OMEGA] * scene.period / (2.0 * np.pi)
    meeting = np.outer(modes.frequencies_hz, 1.0 / np.unique(orders[orders > 0.0])).ravel()
    between = meeting[(meeting > response.low) & (meeting < response.high)]
    inner = np.sort(between)[:MOST_RESONANCES]
    return [float(value) for value in (response.first, *inner, response.last) if value > 0.0]


@dataclass(frozen=True, eq=False)
class LinearModel:
    """A structure reduced to its component modes, geometrically linear.

    Attributes:
        vectors: (local, n) basis.
        model: the reduced model.
    """

    vectors: Array
    model: ReducedModel


def linear_model(structure: Structure, modes: ComponentModes) -> LinearModel:
    """Reduce a structure to its component modes, without geometric nonlinearity.

    Args:
        structure: the structure.
        modes: component modes of the structure.
    """
    labels = [label for label in modes.labels if label.endswith("V")]
    vectors = np.concatenate([modes.normal, modes.loads.vectors], axis=1)
    basis = build_basis(structure, modes, vectors, [*labels, *modes.loads.labels])
    return LinearModel(basis.vectors, project(structure, basis, nonlinear=False))


def linear_snapshots(
    structure: Structure, scene: Scene, linear: LinearModel, frequency: float | None = None
) -> Array:
    """Compute a geometrically linear transient with friction in the component modes.

    Args:
        structure: the structure.
        scene: its contacts and time integration.
        linear: the linear model of the structure.
        frequency: the lowest frequency of the loads, Hz; by default that of the scene.

    Returns:
        Coordinates (n, s) over the last period.

    Raises:
        AccuracyError: the energy balance is off.
        ConvergenceError: a time step did not converge, or the motion grows beyond bounds because
            static follower pressures make the equilibrium unstable.
    """
    model = linear.model
    scene = replace(scene, time=transient_time(scene))
    require_bounded(model, scene)
    if frequency is None:
        problem = checked_problem(model, scene)
    else:
        settled = Problem.of(model, scene).settled()
        problem = frequency_family(settled, spin=bool(np.any(settled.contacts.height)))(frequency)

    def march(time: Time, resume: Checkpoint | None) -> Motion:
        return integrate(problem._replace(time=time), resume=resume, keep_coordinates=True)

    if problem.period is None:
        motion = march(scene.time, None)
    else:  # a few periods at a time: a motion holds its own rows and the last period before
        resume = None
        for first in tracked(range(0, SNAPSHOT_PERIODS, PIECE)):
            last = min(first + PIECE, SNAPSHOT_PERIODS)
            motion = march(scene.time.changed(periods=last), resume)
            if motion.steady:
                break
            resume = motion.end
    assert motion.coordinates is not None and motion.coordinate_time is not None
    rows = snapshot_rows(motion.coordinates, motion.coordinate_time, structure.excitation)
    return np.ascontiguousarray(motion.coordinates[rows].T)


def mode_snapshots(scene: Scene, model: ReducedModel) -> Array:
    """The linear mode of [backbone] at its largest amplitude: with sticking and with open contact.

    Args:
        scene: the scene.
        model: the linear model of the structure.

    Returns:
        Coordinates (n, s) over a period of each mode that moves the probe; none without a backbone.

    Raises:
        ConvergenceError: there is no equilibrium.
    """
    table = scene.backbone
    if table is None:
        return np.zeros((model.size, 0))
    sticking = [mode.shape for mode in linear_modes(Problem.of(model, scene).settled())]
    values, vectors = np.linalg.eig(np.linalg.solve(model.mass, model.rest_stiffness()))
    found: list[Array] = [np.zeros((model.size, 0))]
    turn = np.exp(2j * np.pi * np.arange(MODE_PHASES) / MODE_PHASES)
    for shapes in (sticking, list(vectors[:, np.argsort(values.real)].T)):
        for shape in shapes[table.mode - 1 : table.mode]:
            moves = float(np.max(np.abs(model.probe @ shape), initial=0.0))
            if moves > 0.0:
                moved = np.real(np.outer(shape, turn)) * table.last / moves
                found.append(np.asarray(moved, dtype=np.float64))
    return np.concatenate(found, axis=1)


def require_bounded(model: ReducedModel, scene: Scene) -> None:
    """Refuse the linear transient of an equilibrium that static follower pressures make unstable.

    A model with contacts is not judged, because the contacts may hold the body.

    Args:
        model: the linear model.
        scene: the scene, with the time integration of the transient.

    Raises:
        ConvergenceError: a free vibration grows by more than `UNBOUNDED` during the transient.
    """
    if not model.pressure.numbers.size or model.points.contact.size:
        return
    time = scene.time
    span = time.duration if scene.period is None else SNAPSHOT_PERIODS * scene.period
    rate, frequency = fastest_growth(model)
    if rate * (span or 0.0) <= np.log(UNBOUNDED):
        return
    pressures = [(k, load) for k, load in enumerate(scene.loads) if load.follower and load.static]
    keys = " and ".join(f"loads[{k}].pressure = {load.size:g}" for k, load in pressures)
    how = f"it flutters at {frequency:.4g} Hz" if frequency > 0.0 else "it diverges"
    raise ConvergenceError(
        f"the equilibrium is unstable under the static follower pressure {keys}: {how} and grows "
        f"by a factor e in {1.0 / rate:.3g} s, so the linear transient that selects derivatives "
        'grows beyond bounds; lower the pressure, or set basis.derivatives = "all", which needs '
        "no transient",
        kind=ErrorKind.INSTABILITY,
    )


def fastest_growth(model: ReducedModel) -> tuple[float, float]:
    """The largest rate of growth of a free vibration of a linear model, 1/s, and its frequency, Hz.

    The rates are the real parts of λ in (λ² M + λ (α M + D) + K) φ = 0, with the static follower
    pressures in K.
    """
    found = roots(model.mass, model.damping_matrix(), model.rest_stiffness())
    largest = found[np.argmax(found.real)]
    return float(largest.real), float(abs(largest.imag)) / (2.0 * np.pi)


def transient_time(scene: Scene) -> Time:
    """The time integration of the linear transient of a scene."""
    time = scene.time
    if scene.period is None:
        return time
    steadiness = max(time.tolerance or 0.0, SNAPSHOT_STEADINESS)
    return time.changed(periods=SNAPSHOT_PERIODS, steady_tolerance=steadiness, steady="march")


def snapshot_rows(coordinates: Array, time: Array, excitation: float) -> NDArray[np.int64]:
    """Choose at most `SNAPSHOTS` rows of a motion, and the extremes of fast ones.

    Rows at equal distances may meet fast motions only at their zeros. If fewer than `RESOLVED` rows
    lie in a period of the excitation, the distances follow the fractional parts of the multiples of
    the golden ratio, which repeat with no period. The rows in which a coordinate is largest are
    added.

    Args:
        coordinates: (k, n) coordinates of the motion.
        time: (k,) s.
        excitation: the highest frequency that the scene excites, Hz.
    """
    count = coordinates.shape[0]
    stride = -(-count // SNAPSHOTS)
    equal = np.arange(0, count, stride)
    if stride == 1 or equal.size > RESOLVED * excitation * (time[-1] - time[0]):
        return equal
    spread = np.mod(np.arange(SNAPSHOTS) * (np.sqrt(5.0) - 1.0) / 2.0, 1.0)
    extremes = np.argmax(np.abs(coordinates), axis=0)
    return np.unique(np.concatenate([(count * spread).astype(np.int64), extremes]))


def static_snapshots(structure: Structure, deflection: Array) -> Array:
    """Compute nonlinear static deflections.

    The force f = K u (eq. 18) holds the linear structure in its largest deflection u of the linear
    transient. It acts at equal levels, in addition to the static loads.

    Args:
        structure: the structure.
        deflection: (local,) u, m.

    Returns:
        Deflections (local, `STATIC_LEVELS`) from the equilibrium, m.

    Raises:
        ConvergenceError: the statics did not converge.
    """
    force = structure.held_times(deflection[:, None])[:, 0]
    parts = [level / STATIC_LEVELS for level in range(1, STATIC_LEVELS + 1)]
    found = structure.load_path(force, tracked(parts), STATIC_ACCURACY)
    return np.asarray(found - structure.equilibrium[:, None])
