"""Time integration: one statement of the algorithm, for every model.

A one-step scheme balances weighted means of the forces over a step h, with dq = q1 - q0:

    M [(1 - am) a1 + am a0] + alpha M [(1 - af) v1 + af v0] + f_mean(q0, q1) + B F_mean = (1 - af) p1 + af p0
    a1 = dq/(beta h^2) - v0/(beta h) - (1/(2 beta) - 1) a0,    v1 = v0 + h ((1 - gamma) a0 + gamma a1)

average acceleration (am = af = 0) and generalised-alpha weigh the elastic and contact forces at the ends of the step;
the discrete gradient (am = af = 1/2, beta = 1/4, gamma = 1/2) takes the elastic force averaged along the straight line from
q0 to q1, int_0^1 f(q0 + s dq) ds by Gauss points that are exact for the model, and the discrete gradient of the normal
contact energy: work and energy then balance exactly, whatever the step. Friction is that of `fenicsrom.contact`: it
dissipates in every step. Where the model turns, its gyroscopic forces Gamma v join those of damping.

Each Newton iteration solves the structure for the residual and for unit contact forces, and then the contact problem
exactly in the few contact coordinates (`fenicsrom.contact.resolve`): the iteration over the structure sees no kink. It
stops when the Newton decrement |r . dq| to come falls below `NEWTON_TOLERANCE` squared times the energy in the system, a
test that means the same in any units. A step that does not converge is halved.

`march` below is plain Python. Run as it stands, it integrates any object with the methods of `Model`; compiled by numba, it
integrates a `ReducedModel`, for which the same operations are the compiled functions of `fenicsrom.reduced`.
"""

from __future__ import annotations

import copy
import time as clock
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np
from numba import types
from numba.core import cgutils, ir_utils
from numba.extending import intrinsic, overload, register_jitable
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from fenicsrom import contact
from fenicsrom.contact import Contacts
from fenicsrom.dense import compiled
from fenicsrom.errors import AccuracyError, ConvergenceError
from fenicsrom.reduced import ReducedModel
from fenicsrom.signals import Signals, instants, largest, quarter_period
from fenicsrom.statics import equilibrium

Array = NDArray[np.float64]

NEWTON_TOLERANCE = 1e-14
NEWTON_ROUNDING = 1e-13  # a decrement below this part of the energy that no longer falls is rounding
CONTACT_ROUNDING = 1e-14  # the same, of the contact forces times the displacements from the undeformed body
NEWTON_ITERATIONS = 15
STEP_SHARE = 0.01  # of the tolerance that one adaptive step may spend
# largest imbalance of the energy ledger, relative to the largest energy plus the largest work of the run: what Newton's
# tolerance leaves of it for the scheme that conserves energy; for the others a sign that they are not stable. Only created
# energy counts against generalised-alpha, whose purpose is to lose some.
LEDGER_TOLERANCE = {"discrete-gradient": 1e-6, "average-acceleration": 0.05, "generalised-alpha": 0.05}
SMALLEST_STEP = 1e-6  # of the nominal step; smaller ones end the run

DONE, FULL, FAILED = 0, 1, 2


class Model(Protocol):
    """What the algorithm asks of a model of n coordinates and m contact displacements (here: the rows on this rank)."""

    linear: bool
    gyroscopic: bool
    gauss_points: int
    loads: Array  # (n, loads) unit loads
    signals: Signals  # their time factors

    def elastic_over_step(
        self, start: Array, q0: Array, dq: Array, start_weight: float, points: Array, weights: Array
    ) -> tuple[Array, Any]:
        """Mean force start_weight*start + sum_g w_g f(q0 + s_g dq), and (in a form of the model's own) its derivative."""

    def elastic_at(self, q: Array) -> tuple[Array, float]:
        """Elastic force and energy at q."""

    def responses(self, inertia: float, drag: float, slope: Any, residual: Array) -> tuple[Array, Array, Array]:
        """Solve (inertia M + drag Gamma + slope) [y, Z] = [-residual, B]; returns y (n,), Z (n, m), B^T Z (m, m)."""

    def contact_displacement(self, q: Array) -> Array:
        """Contact displacement (m,)."""

    def probe_displacement(self, q: Array) -> Array:
        """Displacement (d,) of the probe."""

    def mass_times(self, v: Array) -> Array:
        """M v."""

    def gyroscopic_times(self, v: Array) -> Array:
        """Gamma v, of a model that is `gyroscopic`."""

    def dot(self, a: Array, b: Array) -> float:
        """Inner product over all ranks."""

    def load(self, time: float) -> Array:
        """Load vector at a time."""


# The operations of a model: its method of that name, in compiled code too.


def _is_reduced(model: Any) -> bool:
    return isinstance(model, types.NamedTuple) and model.instance_class is ReducedModel


def elastic_over_step(model, start, q0, dq, start_weight, points, weights):  # type: ignore[no-untyped-def]  # noqa: D103
    return model.elastic_over_step(start, q0, dq, start_weight, points, weights)


@overload(elastic_over_step, inline="always", strict=False)
def _elastic_over_step(model, start, q0, dq, start_weight, points, weights):  # type: ignore[no-untyped-def]
    return ReducedModel.elastic_over_step if _is_reduced(model) else None


def elastic_at(model, q):  # type: ignore[no-untyped-def]  # noqa: D103
    return model.elastic_at(q)


@overload(elastic_at, inline="always", strict=False)
def _elastic_at(model, q):  # type: ignore[no-untyped-def]
    return ReducedModel.elastic_at if _is_reduced(model) else None


def responses(model, inertia, drag, slope, residual):  # type: ignore[no-untyped-def]  # noqa: D103
    return model.responses(inertia, drag, slope, residual)


@overload(responses, inline="always", strict=False)
def _responses(model, inertia, drag, slope, residual):  # type: ignore[no-untyped-def]
    return ReducedModel.responses if _is_reduced(model) else None


def contact_displacement(model, q):  # type: ignore[no-untyped-def]  # noqa: D103
    return model.contact_displacement(q)


@overload(contact_displacement, inline="always", strict=False)
def _contact_displacement(model, q):  # type: ignore[no-untyped-def]
    return ReducedModel.contact_displacement if _is_reduced(model) else None


def probe_displacement(model, q):  # type: ignore[no-untyped-def]  # noqa: D103
    return model.probe_displacement(q)


@overload(probe_displacement, inline="always", strict=False)
def _probe_displacement(model, q):  # type: ignore[no-untyped-def]
    return ReducedModel.probe_displacement if _is_reduced(model) else None


def mass_times(model, v):  # type: ignore[no-untyped-def]  # noqa: D103
    return model.mass_times(v)


@overload(mass_times, inline="always", strict=False)
def _mass_times(model, v):  # type: ignore[no-untyped-def]
    return ReducedModel.mass_times if _is_reduced(model) else None


def gyroscopic_times(model, v):  # type: ignore[no-untyped-def]  # noqa: D103
    return model.gyroscopic_times(v)


@overload(gyroscopic_times, inline="always", strict=False)
def _gyroscopic_times(model, v):  # type: ignore[no-untyped-def]
    return ReducedModel.gyroscopic_times if _is_reduced(model) else None


def dot(model, a, b):  # type: ignore[no-untyped-def]  # noqa: D103
    return model.dot(a, b)


@overload(dot, inline="always", strict=False)
def _dot(model, a, b):  # type: ignore[no-untyped-def]
    return ReducedModel.dot if _is_reduced(model) else None


def load(model, time):  # type: ignore[no-untyped-def]  # noqa: D103
    return model.load(time)


@overload(load, inline="always", strict=False)
def _load(model, time):  # type: ignore[no-untyped-def]
    return ReducedModel.load if _is_reduced(model) else None


# Numba counts the references to every array of every tuple that is handed on, in atomic operations that took more than
# half of the time. So the compiled loop works with arrays that have no owner to count for: its caller holds them.


def borrowed(value):  # type: ignore[no-untyped-def]  # noqa: D103
    return value


def _without_owners(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    if isinstance(kind, types.BaseTuple):
        members = [_without_owners(context, builder, k, builder.extract_value(value, i)) for i, k in enumerate(kind)]
        return context.make_tuple(builder, kind, members)
    if isinstance(kind, types.Array):
        array = context.make_array(kind)(context, builder, value)
        array.meminfo = cgutils.get_null_value(array.meminfo.type)
        array.parent = cgutils.get_null_value(array.parent.type)
        return array._getvalue()
    return value


@intrinsic
def _borrow(typing_context, value):  # type: ignore[no-untyped-def]
    return value(value), lambda context, builder, _, arguments: _without_owners(context, builder, value, arguments[0])


@overload(borrowed, jit_options={"forceinline": True})
def _borrowed(value):  # type: ignore[no-untyped-def]
    return lambda value: _borrow(value)


def _same_memory(result, arguments, aliases, argument_aliases):  # type: ignore[no-untyped-def]
    """Tell numba that to write to what is borrowed is to write to the argument, and not dead code."""
    ir_utils._add_alias(result, arguments[0].name, aliases, argument_aliases)


ir_utils.alias_func_extensions["borrowed", __name__] = _same_memory


class Scheme(NamedTuple):
    """The weights of a one-step scheme (module docstring).

    Attributes:
        alpha_m: weight am of the old acceleration.
        alpha_f: weight af of the old velocity, load and friction.
        beta: Newmark's beta.
        gamma: Newmark's gamma.
        line: elastic and normal contact force are means along the step.
        start_weight: weight of the elastic force at the start of the step.
        points: (g,) where along the step the elastic force is taken.
        weights: (g,) with what weights.
        damping: alpha of the model, 1/s.
        linear: the model's force is linear: one iteration solves the step.
        gyroscopic: the model has gyroscopic forces.
    """

    alpha_m: float
    alpha_f: float
    beta: float
    gamma: float
    line: bool
    start_weight: float
    points: Array
    weights: Array
    damping: float
    linear: bool
    gyroscopic: bool


def scheme(name: str, model: Any, spectral_radius: float = 0.8) -> Scheme:
    """The scheme of this name for a model.

    Args:
        name: "average-acceleration", "generalised-alpha" or "discrete-gradient".
        model: gives the damping, whether it is linear, and the Gauss points that integrate its force exactly.
        spectral_radius: of generalised-alpha at infinite frequency, in [0, 1].
    """
    model_is = float(model.damping), bool(model.linear), bool(model.gyroscopic)
    end = np.ones(1)
    if name == "average-acceleration":
        return Scheme(0.0, 0.0, 0.25, 0.5, False, 0.0, end, end, *model_is)
    if name == "generalised-alpha":
        am = (2.0 * spectral_radius - 1.0) / (spectral_radius + 1.0)
        af = spectral_radius / (spectral_radius + 1.0)
        beta, gamma = 0.25 * (1.0 - am + af) ** 2, 0.5 - am + af
        return Scheme(am, af, beta, gamma, False, af, end, np.array([1.0 - af]), *model_is)
    if name == "discrete-gradient":
        points, weights = np.polynomial.legendre.leggauss(model.gauss_points)
        return Scheme(0.5, 0.5, 0.25, 0.5, True, 0.0, 0.5 + 0.5 * points, 0.5 * weights, *model_is)
    raise ValueError(f"scheme {name!r}: allowed are average-acceleration, generalised-alpha and discrete-gradient")


class Control(NamedTuple):
    """How the step is chosen.

    Attributes:
        grid: the run stops on multiples of this time after `origin`, s; the step never exceeds it.
        tolerance: adaptive: the local error of a step is at most `STEP_SHARE` of it, relative to the size of the motion;
            0: fixed step.
        size: smallest size of motion to measure errors against, in the mass norm.
    """

    grid: float
    tolerance: float
    size: float


# the scalars of a state
TIME, STEP, LAST, WORK, DAMPED, RUBBED, KINETIC, ELASTIC, CONTACT, SCALE, SIZE, STEPS, REJECTED, ITERATIONS = range(14)
SCALARS = 14


class Trial(NamedTuple):
    """The step that is being tried.

    Attributes:
        dq: (n,) the step.
        change: (n,) its last change in the iteration; then the new velocity.
        residual: (n,) of the equations of motion.
        rest: (n,) M times this is the part of the inertia and damping forces that does not depend on dq.
        push: (n,) mean load.
        total: (n,) a sum to be handed on.
        touch: the contact points at the end of the step.
        before: (P, d) their displacement before the iteration.
        free: (P, d) their displacement without contact forces.
        room: for the contact problem; holds the mean contact force over the step.
    """

    dq: Array
    change: Array
    residual: Array
    rest: Array
    push: Array
    total: Array
    touch: contact.Touch
    before: Array
    free: Array
    room: contact.Room


class State(NamedTuple):
    """The last accepted state; only acceptance of a step writes to it (but for `trial`).

    Attributes:
        q: (n,) displacement coordinates.
        v: (n,) velocity.
        a: (n,) acceleration of the scheme.
        rate: (n,) mean velocity dq/h over the last step.
        growth: (n,) how that changed from the step before, per time: together they extrapolate to the next step, and the
            distance of the solution from that extrapolation estimates the error.
        start: (n,) elastic force at q, where the scheme asks for it.
        load: (n,) load vector at the time.
        touch: the contact points.
        rubbed: (P,) energy that each has dissipated by friction, J.
        scalars: time, next step, last step, work of the loads and of moving surfaces, energies dissipated by damping and
            friction, kinetic, elastic and contact energy, energy and displacement scales of the run, counts of steps,
            rejected steps and iterations.
        trial: the step that is being tried: no part of the state, but room that is needed at every step.
    """

    q: Array
    v: Array
    a: Array
    rate: Array
    growth: Array
    start: Array
    load: Array
    touch: contact.Touch
    rubbed: Array
    scalars: Array
    trial: Trial


class Record(NamedTuple):
    """Room for what is kept of each accepted step: (rows, ..)."""

    time: Array
    displacement: Array
    probe: Array
    force: Array
    mean_force: Array
    gap: Array
    rubbed: Array
    state: NDArray[np.int8]
    energies: Array
    coordinates: Array


# In compiled code a new array costs more than the arithmetic on these short vectors: they are written into room that is there.


def combine(out, *terms):  # type: ignore[no-untyped-def]
    """Write a x + b y + .. into out (n,), which may be one of the vectors; the terms are a, x, b, y, .. , at most three."""
    out[:] = sum(factor * vector for factor, vector in zip(terms[::2], terms[1::2], strict=True))


@overload(combine, jit_options={"_nrt": False})
def _combine(out, *terms):  # type: ignore[no-untyped-def]
    def two(out, *terms):  # type: ignore[no-untyped-def]
        a, x, b, y = terms
        for i in range(out.size):
            out[i] = a * x[i] + b * y[i]

    def three(out, *terms):  # type: ignore[no-untyped-def]
        a, x, b, y, c, z = terms
        for i in range(out.size):
            out[i] = a * x[i] + b * y[i] + c * z[i]

    return {4: two, 6: three}.get(len(terms))


@register_jitable(inline="always")
def keep(out, vector):  # type: ignore[no-untyped-def]
    """Write a vector (n,) into out, element by element: compiled, a slice costs more than it copies."""
    for i in range(out.size):
        out[i] = vector[i]


def answer(out, y, unit, mean):  # type: ignore[no-untyped-def]
    """Write into out what the structure does: y (n,) and its response unit (n, P d) to the contact forces mean (P, d)."""
    out[:] = y - np.dot(unit, mean.reshape(-1))


@overload(answer, jit_options={"_nrt": False})
def _answer(out, y, unit, mean):  # type: ignore[no-untyped-def]
    def write_answer(out, y, unit, mean):  # type: ignore[no-untyped-def]
        d = mean.shape[1]
        for i in range(y.size):
            value = y[i]
            for j in range(mean.size):
                value -= unit[i, j] * mean[j // d, j % d]
            out[i] = value

    return write_answer


@register_jitable(inline="always")
def put(points, displacement):  # type: ignore[no-untyped-def]
    """Write displacements (P d,) into (P, d)."""
    d = points.shape[1]
    for p in range(points.shape[0]):
        for k in range(d):
            points[p, k] = displacement[p * d + k]


@register_jitable(inline="always")
def extrapolate(out, state, h):  # type: ignore[no-untyped-def]
    """Write dq of a step of size h as the steps before foretell it: the velocities of the scheme may ring, dq/h does not."""
    combine(out, h, state.rate, 0.5 * h * (h + state.scalars[LAST]), state.growth)


@register_jitable(inline="always")
def inertia_of(scheme, h):  # type: ignore[no-untyped-def]
    """Factor of M dq in the balance of a step of size h."""
    kept = scheme.damping * (1.0 - scheme.alpha_f) * scheme.gamma / (scheme.beta * h)
    return (1.0 - scheme.alpha_m) / (scheme.beta * h * h) + kept


@register_jitable(inline="always")
def attempt(model, contacts, scheme, state, h, load_ahead):  # type: ignore[no-untyped-def]
    """Solve one step of size h from `state`, writing only to its trial; returns (converged, iterations)."""
    am, af, beta, gamma = scheme.alpha_m, scheme.alpha_f, scheme.beta, scheme.gamma
    trial, room = state.trial, state.trial.room
    points, d = trial.free.shape
    dq, residual, change, total, x = trial.dq, trial.residual, trial.change, trial.total, trial.touch.x
    q0, v0, a0 = state.q, state.v, state.a
    interval = contact.Interval(state.scalars[TIME], state.scalars[TIME] + h, af, scheme.line)
    # the mean velocity over the step is drag dq + drag_v v0 + drag_a a0, the mean acceleration likewise: M times `rest` is what
    # does not depend on dq in the forces of inertia and damping, and `inertia` the factor of M dq in them
    drag = (1.0 - af) * gamma / (beta * h)
    drag_v = (1.0 - af) * (1.0 - gamma / beta) + af
    drag_a = (1.0 - af) * h * (1.0 - 0.5 * gamma / beta)
    from_v = -(1.0 - am) / (beta * h) + scheme.damping * drag_v
    from_a = am - (1.0 - am) * (0.5 / beta - 1.0) + scheme.damping * drag_a
    combine(trial.rest, from_v, v0, from_a, a0)
    inertia = inertia_of(scheme, h)
    combine(trial.push, 1.0 - af, load_ahead, af, state.load)
    extrapolate(dq, state, h)
    combine(total, 1.0, q0, 1.0, dq)
    put(x, contact_displacement(model, total))
    first, last = 0.0, 0.0
    for iteration in range(1, NEWTON_ITERATIONS + 1):
        elastic, slope = elastic_over_step(
            model, state.start, q0, dq, scheme.start_weight, scheme.points, scheme.weights
        )
        combine(total, 1.0, trial.rest, inertia, dq)
        combine(residual, 1.0, mass_times(model, total), 1.0, elastic, -1.0, trial.push)
        if scheme.gyroscopic:
            combine(total, drag, dq, drag_v, v0, drag_a, a0)
            combine(residual, 1.0, residual, 1.0, gyroscopic_times(model, total))
        y, unit, compliance = responses(model, inertia, drag, slope, residual)
        for p in range(points):
            for k in range(d):
                trial.before[p, k] = x[p, k]
        combine(total, 1.0, q0, 1.0, dq, 1.0, y)
        put(trial.free, contact_displacement(model, total))
        if iteration == 1:
            contact.lean_to_the_end(contacts, interval, compliance, state.touch, room)
        if points > 0 and not contact.resolve(contacts, interval, compliance, trial.free, state.touch, trial.touch, room):
            return False, iteration
        answer(change, y, unit, room.mean)
        combine(dq, 1.0, dq, 1.0, change)
        decrement, carried = dot(model, residual, change), 0.0
        for p in range(points):
            size, far = 0.0, 0.0
            for k in range(d):
                decrement += room.mean[p, k] * (x[p, k] - trial.before[p, k])
                size += abs(room.mean[p, k])
                far = max(far, abs(x[p, k]))
            carried += size * far
        decrement = abs(decrement)
        if not np.isfinite(decrement):
            return False, iteration
        if iteration == 1:
            first = decrement
        scale = max(state.scalars[SCALE], first)
        # what the next decrement will be, Newton's convergence being quadratic; a small one that no longer falls is rounding
        coming = decrement * (decrement / last) ** 2 if iteration > 1 and decrement < 1e-3 * last else decrement
        rounding = decrement <= max(NEWTON_ROUNDING * scale, CONTACT_ROUNDING * carried) and decrement > 0.1 * last
        if scheme.linear or coming <= NEWTON_TOLERANCE**2 * scale or rounding:
            return True, iteration
        if decrement > 1e8 * first:
            return False, iteration
        last = decrement
    return False, NEWTON_ITERATIONS


@register_jitable(inline="always")
def accept(model, contacts, scheme, state, h, load_ahead):  # type: ignore[no-untyped-def]
    """Write a converged step into the state, with its entries in the energy ledger (trapezoidal along the step)."""
    beta, gamma = scheme.beta, scheme.gamma
    s, trial = state.scalars, state.trial
    dq, v1, total = trial.dq, trial.change, trial.total
    combine(v1, 1.0 - gamma / beta, state.v, h * (1.0 - 0.5 * gamma / beta), state.a, gamma / (beta * h), dq)
    s[WORK] += 0.5 * (dot(model, state.load, dq) + dot(model, load_ahead, dq))
    combine(total, 1.0, state.v, 1.0, v1)
    s[DAMPED] += 0.5 * scheme.damping * dot(model, mass_times(model, total), dq)
    interval = contact.Interval(s[TIME], s[TIME] + h, scheme.alpha_f, scheme.line)
    for p in range(trial.free.shape[0]):
        dissipated, surface, lost = contact.settle(contacts, interval, p, state.touch, trial.touch, trial.room)
        s[RUBBED] += dissipated
        state.rubbed[p] += dissipated
        s[WORK] += surface
        s[DAMPED] += lost
    change = 2.0 / (h + s[LAST])
    combine(state.growth, change / h, dq, -change, state.rate)
    combine(state.rate, 1.0 / h, dq, 0.0, state.rate)
    combine(state.q, 1.0, state.q, 1.0, dq)
    if not scheme.line:  # it cancels from the discrete gradient, where it would only carry rounding
        combine(state.a, 1.0 / (beta * h * h), dq, -1.0 / (beta * h), state.v, 1.0 - 0.5 / beta, state.a)
    keep(state.v, v1)
    keep(state.load, load_ahead)
    for p in range(trial.free.shape[0]):
        state.touch.raw[p] = trial.touch.raw[p]
        state.touch.state[p] = trial.touch.state[p]
        for k in range(trial.free.shape[1]):
            state.touch.x[p, k] = trial.touch.x[p, k]
            state.touch.normal[p, k] = trial.touch.normal[p, k]
            state.touch.friction[p, k] = trial.touch.friction[p, k]
            state.touch.slider[p, k] = trial.touch.slider[p, k]
    s[TIME] += h
    s[LAST] = h
    s[STEPS] += 1.0
    measure(model, contacts, scheme, state)


@register_jitable(inline="always")
def measure(model, contacts, scheme, state):  # type: ignore[no-untyped-def]
    """Energies of the state, the scales of the run, and the elastic force the next step starts from."""
    s = state.scalars
    s[KINETIC] = 0.5 * dot(model, state.v, mass_times(model, state.v))
    elastic, s[ELASTIC] = elastic_at(model, state.q)
    keep(state.start, elastic)
    s[CONTACT] = contact.energy(contacts, state.touch)
    s[SCALE] = max(s[SCALE], s[KINETIC] + abs(s[ELASTIC]))
    s[SIZE] = max(s[SIZE], np.sqrt(dot(model, state.q, mass_times(model, state.q))))


@register_jitable(inline="always")
def write(model, contacts, state, record, row):  # type: ignore[no-untyped-def]
    """Keep the state as a row of the record."""
    s = state.scalars
    record.time[row] = s[TIME]
    touch = state.touch
    points, d = touch.x.shape
    if points == 0:
        record.probe[row] = probe_displacement(model, state.q)
    for p in range(points):
        record.state[row, p] = touch.state[p]
        record.rubbed[row, p] = state.rubbed[p]
        record.gap[row, p] = -contact.penetration(contacts, p, touch.x[p], s[TIME])
        # the frame of the point, turned the shortest way so that its first axis is the current normal
        size = 0.0
        for k in range(d):
            size += touch.normal[p, k] ** 2
        size = np.sqrt(size)
        lean = touch.friction[p, 0] / (size + touch.normal[p, 0]) if size > 0.0 else 0.0
        record.force[row, p, 0] = max(touch.raw[p], 0.0)
        for k in range(d):
            record.displacement[row, p, k] = touch.x[p, k]
            record.mean_force[row, p, k] = state.trial.room.mean[p, k]
            if k > 0:
                record.force[row, p, k] = touch.friction[p, k] - lean * touch.normal[p, k]
    for k in range(6):
        record.energies[row, k] = s[WORK + k]
    if record.coordinates.shape[1] > 0:
        n = state.q.size
        record.coordinates[row, :n] = state.q
        record.coordinates[row, n : 2 * n] = state.v
        record.coordinates[row, 2 * n :] = state.a


def march(model, contacts, scheme, control, state, origin, end, record):  # type: ignore[no-untyped-def]
    """Advance the state from its time to `end`, keeping a row of the record for each accepted step.

    Args:
        model: what is integrated: a `Model`, or (compiled) a `ReducedModel`.
        contacts: parameters of the contact points.
        scheme: the weights of the scheme.
        control: how the step is chosen.
        state: where to start; holds the end on return.
        origin: where the grid of times starts, s.
        end: when to stop, s.
        record: room for the rows.

    Returns:
        (status, rows written): DONE, FULL (the record is: call again), or FAILED (the smallest step did not converge).
    """
    model, contacts, scheme = borrowed(model), borrowed(contacts), borrowed(scheme)
    state, record = borrowed(state), borrowed(record)
    s = state.scalars
    rows = 0
    slack = 1e-9 * control.grid
    while end - s[TIME] > slack:
        if rows == record.time.size:
            return FULL, rows
        goal = min(end, origin + control.grid * (np.floor((s[TIME] - origin) / control.grid + 1e-6) + 1.0))
        h = min(s[STEP], goal - s[TIME])
        lands = goal - s[TIME] - h <= slack
        if lands:
            h = goal - s[TIME]
        elif control.tolerance > 0.0 and goal - s[TIME] < 2.0 * h:
            h = 0.5 * (goal - s[TIME])  # two equal steps instead of a full one and a sliver
        load_ahead = load(model, s[TIME] + h)
        converged, iterations = attempt(model, contacts, scheme, state, h, load_ahead)
        s[ITERATIONS] += iterations
        factor = 0.5
        if converged and control.tolerance > 0.0 and s[LAST] > 0.0:
            surprise = state.trial.change
            extrapolate(surprise, state, h)
            inertia = inertia_of(scheme, h)
            combine(surprise, -inertia, state.trial.dq, inertia, surprise)
            # vibration too fast for the step rings, but does not grow: filtered by (inertia M + K)^-1 inertia M, the error
            # of what the step resolves remains
            _, slope = elastic_over_step(
                model, state.start, state.q, state.trial.dq, scheme.start_weight, scheme.points, scheme.weights
            )
            error, _, _ = responses(model, inertia, 0.0, slope, mass_times(model, surprise))
            size = max(s[SIZE], control.size)
            local = np.sqrt(dot(model, error, mass_times(model, error))) / 12.0
            ratio = local / (STEP_SHARE * control.tolerance * size) if size > 0.0 else 0.0
            converged = ratio <= 1.0
            factor = min(2.0, max(0.2, 0.9 / np.cbrt(max(ratio, 1e-12))))
            if converged and iterations > 8:
                factor = min(factor, 1.0)
        elif converged:
            factor = 2.0
        if converged:
            nominal = s[STEP]
            accept(model, contacts, scheme, state, h, load_ahead)
            if lands:
                s[TIME] = goal
            # a step cut short to land on the grid says nothing against the longer one
            s[STEP] = min(control.grid, max(factor * h, nominal if lands and factor >= 1.0 else 0.0))
            write(model, contacts, state, record, rows)
            rows += 1
        else:
            s[REJECTED] += 1.0
            s[STEP] = factor * h
            if not s[STEP] > SMALLEST_STEP * control.grid:
                return FAILED, rows
    return DONE, rows


_compiled_march = compiled(march)


class Checkpoint(NamedTuple):
    """Where a run stands between two periods (or, without a period, two steps): all that follows depends on, bit for bit.

    Attributes:
        state: the state.
        last: the rows of the last period, by which the next is judged steady; without a period the last ones, at most 4096.
        size: of the motion, that errors are measured against (`Control.size`).
        spans: periods run.
        buckled: as in `Motion`.
    """

    state: State
    last: Record
    size: float
    spans: int
    buckled: int


@dataclass(frozen=True, eq=False)
class Motion:
    """A motion in time: ns accepted steps, the start included; P contact points in d dimensions.

    Attributes:
        time: (ns,) s.
        period: of the loads, s; None without harmonic load.
        displacement: (ns, P, d) contact displacement in the local frames [normal, tangents], or (ns, 1, d) of the probe in
            global axes where there is no contact, m.
        force: (ns, P, d) contact forces [N, T] acting against the motion, along the normal of the current position and the
            tangents there (the frame of the point turned the shortest way), N.
        mean_force: (ns, P, d) mean contact force over the step that ended there, in the frames of the points, N.
        gap: (ns, P) distance from the surface, negative inside it, m.
        state: (ns, P) -1 open, 0 slip, 1 stick.
        kinetic: (ns,) kinetic energy, J.
        elastic: (ns,) elastic energy from the equilibrium, J.
        contact_energy: (ns,) energy of the contact springs, J.
        work: (ns,) work of the loads, and of surfaces that move, since the start, J.
        damped: (ns,) energy dissipated since the start by damping, and by impacts too short for the step, J.
        rubbed: (ns,) energy dissipated by friction since the start, J.
        point_rubbed: (ns, P) the same of each contact point, J.
        steady: whether the motion was found to repeat.
        periods: number of periods run.
        steps: accepted steps.
        rejected: rejected steps.
        newton_iterations: of all steps, rejected ones included.
        seconds: run time of the integration, compilation excluded.
        coordinates: (k, n) coordinates q of the last period, where they were asked for.
        velocity: (k, n) their velocities in the scheme.
        acceleration: (k, n) their accelerations in the scheme (zero for the discrete gradient, which does without).
        coordinate_time: (k,) their times, s.
        end: where it ended, to go on from.
        buckled: number of directions in which the equilibrium that lies nearest was unstable: it started in another.
    """

    time: Array
    period: float | None
    displacement: Array
    force: Array
    mean_force: Array
    gap: Array
    state: NDArray[np.int8]
    kinetic: Array
    elastic: Array
    contact_energy: Array
    work: Array
    damped: Array
    rubbed: Array
    point_rubbed: Array
    steady: bool
    periods: int
    steps: int
    rejected: int
    newton_iterations: int
    seconds: float
    coordinates: Array | None = None
    velocity: Array | None = None
    acceleration: Array | None = None
    coordinate_time: Array | None = None
    end: Checkpoint | None = None
    buckled: int = 0

    @property
    def imbalance(self) -> Array:
        """(ns,) the energy ledger: energy + dissipated - work - initial, J; 0 but for the scheme's own error."""
        energy = self.kinetic + self.elastic + self.contact_energy
        spent = self.damped + self.rubbed - self.work
        return energy - energy[0] + spent - spent[0]

    @property
    def relative_imbalance(self) -> float:
        """Largest imbalance relative to the largest kinetic plus elastic energy of the run."""
        scale = np.max(self.kinetic + np.abs(self.elastic))
        return float(np.max(np.abs(self.imbalance)) / scale) if scale > 0.0 else 0.0

    def last_period(self) -> slice:
        """The steps of the last period, both its ends included; all steps where there is no period."""
        if self.period is None:
            return slice(0, self.time.size)
        start = np.searchsorted(self.time, self.time[-1] - self.period * (1.0 + 1e-9))
        return slice(int(start), self.time.size)


def no_state(n: int, points: int, dimension: int) -> State:
    """A state of zeros, of n coordinates and P contact points."""

    def zeros() -> Array:
        return np.zeros(n)

    trial = Trial(
        zeros(), zeros(), zeros(), zeros(), zeros(), zeros(), contact.touch(points, dimension), np.zeros((points, dimension)),
        np.zeros((points, dimension)), contact.room(points, dimension),
    )  # fmt: skip
    return State(
        zeros(), zeros(), zeros(), zeros(), zeros(), zeros(), zeros(), contact.touch(points, dimension), np.zeros(points),
        np.zeros(SCALARS), trial,
    )  # fmt: skip


def no_record(rows: int, points: int, dimension: int, width: int = 0) -> Record:
    """Room for so many rows, of P contact points and, where they are kept, coordinates (width,)."""
    return Record(
        np.zeros(rows), np.zeros((rows, points, dimension)), np.zeros((rows, dimension)), np.zeros((rows, points, dimension)),
        np.zeros((rows, points, dimension)), np.zeros((rows, points)), np.zeros((rows, points)),
        np.zeros((rows, points), dtype=np.int8), np.zeros((rows, 6)), np.zeros((rows, width)),
    )  # fmt: skip


def initial_state(
    model: Any, contacts: Contacts, scheme: Scheme, dimension: int, q: Array, v: Array, sliders: Array | None = None
) -> State:
    """The state at t = 0 with the acceleration that balances the forces; sliders rest where the points are, unless given."""
    x = contact_displacement(model, q).reshape(-1, dimension).copy()
    state = no_state(q.size, x.shape[0], dimension)
    contact.at_rest(contacts, x, x.copy() if sliders is None else sliders, 0.0, state.touch, state.trial.room)
    zero, push = np.zeros_like(q), load(model, 0.0).copy()
    state.q[:], state.v[:], state.rate[:], state.load[:] = q, v, v, push
    measure(model, contacts, scheme, state)
    if not scheme.line:
        _, nothing = elastic_over_step(model, zero, q, zero, 0.0, np.ones(1), np.zeros(1))
        residual = state.start + scheme.damping * mass_times(model, v) - push
        if scheme.gyroscopic:
            residual += gyroscopic_times(model, v)
        y, unit, _ = responses(model, 1.0, 0.0, nothing, residual)
        state.a[:] = y - unit @ (state.touch.normal + state.touch.friction).reshape(-1)
        state.growth[:] = state.a
    return state


def static_size(model: Any, contacts: Contacts, dimension: int, q: Array) -> float:
    """Size in the mass norm of the linear static response to the largest loads and the preload: a scale for errors."""
    _, slope = elastic_over_step(model, np.zeros_like(q), q, np.zeros_like(q), 0.0, np.ones(1), np.ones(1))
    push = np.abs(model.loads) @ largest(model.signals)
    y, unit, _ = responses(model, 0.0, 0.0, slope, -push)
    preload = np.zeros((contacts.preload.size, dimension))
    preload[:, 0] = contacts.preload
    y = np.abs(y) + np.abs(unit) @ preload.reshape(-1)
    return float(np.sqrt(dot(model, y, mass_times(model, y))))


def integrate(
    model: Any,
    contacts: Contacts,
    settings: Any,
    period: float | None,
    *,
    dimension: int,
    start: tuple[Array, ...] | None = None,
    resume: Checkpoint | None = None,
    keep_coordinates: bool = False,
    compiled: bool = True,
    progress: Callable[[float, float], None] | None = None,
    checkpoint: Callable[[Checkpoint], None] | None = None,
) -> Motion:
    """Integrate a model to its steady state, or to the given time.

    Args:
        model: a `ReducedModel` or any `Model`.
        contacts: parameters of the P contact points, in the order of the model's contact displacements.
        settings: a `fenicsrom.scene.Time`: scheme, step or tolerance, periods, steady tolerance, or duration.
        period: of the loads, s; None runs for `settings.duration`.
        dimension: d, of space.
        start: displacement and velocity (n,), and sliders (P, d) if they are not at rest, at t = 0; at rest in the
            equilibrium under static loads and preload without it (`fenicsrom.statics`).
        resume: go on from where a run stood: what follows is what would have followed, bit for bit.
        keep_coordinates: keep the coordinates of the last period.
        compiled: False runs a `ReducedModel` in plain Python, the slow twin of the compiled loop.
        progress: called after each period with the fraction of the run done and the change since the last period.
        checkpoint: called after each period (or some thousand steps) with where the run stands; what it is given is
            overwritten afterwards.

    Returns:
        The motion, steady or at the end of the periods (`Motion.steady` says which); of a resumed run from the last period
        before.

    Raises:
        ConvergenceError: at the smallest step Newton did not converge; `partial` holds the motion up to there.
        AccuracyError: the energy ledger is off by more than `LEDGER_TOLERANCE`; `partial` holds the motion.
    """
    plan = scheme(settings.scheme, model, settings.spectral_radius)
    advance = _compiled_march if compiled and isinstance(model, ReducedModel) else march
    horizon = float(period if period is not None else settings.duration)
    tolerance = settings.tolerance or 0.0
    step = period / settings.steps_per_period if period is not None and not tolerance else settings.step
    stops, grid = np.array([horizon]), horizon if tolerance else step
    if tolerance and period is None:  # steps that cannot miss a load
        stops, grid = instants(model.signals, horizon), min(horizon, quarter_period(model.signals))
    nothing, buckled = np.zeros_like(load(model, 0.0)), 0
    if resume is not None:
        state, done, buckled = copy.deepcopy(resume.state), resume.spans if period is not None else 0, resume.buckled
        control = Control(grid, tolerance, resume.size)
    else:
        if start is None:
            q, buckled = equilibrium(model, contacts, dimension)
            start = (q, nothing)
        state, done = initial_state(model, contacts, plan, dimension, *start), 0
        state.scalars[STEP] = 1e-4 * min(grid, stops[0]) if tolerance else step
        size = state.scalars[SIZE]
        if tolerance:
            size = max(size, static_size(model, contacts, dimension, start[0]))
        control = Control(grid, tolerance, size)
    s = state.scalars
    points, width, rows = state.touch.x.shape[0], 3 * state.q.size if keep_coordinates else 0, 4096
    if keep_coordinates and not tolerance:
        rows = min(rows, round(horizon / step) + 1)
    record = no_record(rows, points, dimension, width)
    write(model, contacts, state, record, 0)
    history = [_rows([record], [1])]
    if resume is not None:
        history = [resume.last._replace(coordinates=np.repeat(history[0].coordinates, resume.last.time.size, axis=0))]
    if advance is not march:  # compile outside of the clock: a call that finds nothing to do
        advance(model, contacts, plan, control, state, 0.0, 0.0, record)
    begin = clock.perf_counter()
    spans = settings.periods if period is not None else 1
    steady, status = False, DONE

    def stand(span: int) -> Checkpoint:
        return Checkpoint(state, history[-1], float(control.size), span, buckled)

    span = done
    for span in range(done + 1, spans + 1):
        q0, pieces, counts = state.q.copy(), [], []
        for stop in stops:
            status = FULL
            while status == FULL:
                origin, end = (span - 1) * horizon, (span - 1 + stop / horizon) * horizon
                status, count = advance(model, contacts, plan, control, state, origin, end, record)
                pieces.append(_copy(record, count))
                counts.append(count)
                if checkpoint is not None and period is None and count:
                    checkpoint(Checkpoint(state, _rows(pieces[-1:], [count]), float(control.size), 0, buckled))
            if status == FAILED:
                break
        history[-1] = history[-1]._replace(coordinates=history[-1].coordinates[-1:])  # one row: where this period starts
        history.append(_rows(pieces, counts))
        if status == FAILED or period is None:
            break
        change = _change(history[-2], history[-1], period)
        if change <= settings.steady_tolerance:  # where the points, or the probe, repeat: all the rest too?
            change = max(change, _norm(model, state.q - q0) / max(s[SIZE], 1e-300))
        if progress is not None:
            progress(span / spans, change)
        if checkpoint is not None:
            checkpoint(stand(span))
        if change <= settings.steady_tolerance:
            steady = True
            break
    seconds = clock.perf_counter() - begin
    motion = _motion(history, period, steady, s, seconds, stand(span))
    if status == FAILED or not np.all(np.isfinite(motion.kinetic)):
        names = {-1: "open", 0: "slip", 1: "stick"}
        where = ", ".join(f"point {p + 1} {names[int(c)]}" for p, c in enumerate(state.touch.state)) or "no contact"
        raise ConvergenceError(
            f"time integration stopped at t = {s[TIME]:.6g} s: no convergence with the smallest step "
            f"{SMALLEST_STEP * control.grid:.3g} s ({where}; scheme {settings.scheme}); the motion up to there is kept",
            motion,
        )
    throughput = np.max(motion.kinetic + np.abs(motion.elastic)) + np.max(np.abs(motion.work))
    imbalance = motion.imbalance if settings.scheme == "generalised-alpha" else np.abs(motion.imbalance)
    off, allowed = np.max(imbalance), LEDGER_TOLERANCE[settings.scheme]
    if off > allowed * throughput:
        raise AccuracyError(
            f"time integration: the energy ledger is off by {100.0 * off / throughput:.3g} % of the energy and work, more than "
            f"{100.0 * allowed:.3g} % (scheme {settings.scheme}, {motion.steps} steps): take shorter steps"
            f"{'' if settings.scheme == 'discrete-gradient' else ' or the discrete gradient'}",
            motion,
        )
    return motion


def end_of(motion: Motion) -> tuple[Array, Array, Array]:
    """Coordinates and velocity (n,) and sliders (P, d) at the end of a motion: a start for another run from t = 0."""
    assert motion.end is not None
    state = motion.end.state
    return state.q.copy(), state.v.copy(), state.touch.slider.copy()


def _norm(model: Any, vector: Array) -> float:
    return float(np.sqrt(dot(model, vector, mass_times(model, vector))))


def _copy(record: Record, count: int) -> Record:
    return Record._make(array[:count].copy() for array in record)


def _rows(pieces: list[Record], counts: list[int]) -> Record:
    """The rows written, joined."""
    return Record._make(
        np.concatenate([array[:count] for array, count in zip(arrays, counts, strict=True)])
        for arrays in zip(*pieces, strict=True)
    )


def _change(before: Record, after: Record, period: float) -> float:
    """Largest difference of the contact (or probe) displacement from a period ago, relative to the largest displacement."""
    was: Array = before.displacement.reshape(before.time.size, -1)
    now: Array = after.displacement.reshape(after.time.size, -1)
    if now.shape[1] == 0:
        was, now = before.probe, after.probe
    if before.time.size < 2:
        return np.inf
    if now.shape == was.shape and np.max(np.abs(after.time - period - before.time)) <= 1e-9 * period:
        there = was
    else:  # the steps of the two periods differ: a cubic spline is as exact as the motion
        there = CubicSpline(before.time, was)(np.clip(after.time - period, before.time[0], before.time[-1]))
    return float(np.max(np.abs(now - there)) / max(np.max(np.abs(now)), 1e-300))


def _motion(
    history: list[Record], period: float | None, steady: bool, s: Array, seconds: float, end: Checkpoint
) -> Motion:
    last = [r.coordinates for r in history[-2:]]
    kept: list[Any] = [None] * 3
    if last[-1].size:
        kept = np.split(np.concatenate(last), 3, axis=1)
    whole = _rows([r._replace(coordinates=r.coordinates[:0]) for r in history], [r.time.size for r in history])
    work, damped, rubbed, kinetic, elastic, contact_energy = whole.energies.T
    return Motion(
        time=whole.time,
        period=period,
        displacement=whole.displacement if whole.displacement.shape[1] else whole.probe[:, None, :],
        force=whole.force,
        mean_force=whole.mean_force,
        gap=whole.gap,
        state=whole.state,
        kinetic=kinetic,
        elastic=elastic,
        contact_energy=contact_energy,
        work=work,
        damped=damped,
        rubbed=rubbed,
        point_rubbed=whole.rubbed,
        steady=steady,
        periods=end.spans if period is not None else 0,
        steps=int(s[STEPS]),
        rejected=int(s[REJECTED]),
        newton_iterations=int(s[ITERATIONS]),
        seconds=seconds,
        coordinates=kept[0],
        velocity=kept[1],
        acceleration=kept[2],
        coordinate_time=whole.time[-kept[0].shape[0] :] if kept[0] is not None else None,
        end=end,
        buckled=end.buckled,
    )
