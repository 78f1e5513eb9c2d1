"""The operations that the time stepping asks of a model, in Python and in compiled code."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numba import types
from numba.core import cgutils, ir_utils
from numba.extending import intrinsic, overload, register_jitable

from fenicsrom.arrays import Array
from fenicsrom.online.load_histories import LoadHistories
from fenicsrom.online.model import ReducedModel


class Model(Protocol):
    """What the algorithm asks of a model of n coordinates and m contact displacements (here: the
    rows on this rank).
    """

    linear: bool
    gyroscopic: bool
    gauss_points: int
    loads: Array  # (n, loads) unit loads
    load_histories: LoadHistories  # their time factors

    def elastic_over_step(
        self, start: Array, q0: Array, dq: Array, start_weight: float, points: Array, weights: Array
    ) -> tuple[Array, Any]:
        """Mean force start_weight*start + sum_g w_g f(q0 + s_g dq), and (in a form of the model's
        own) its derivative.
        """

    def elastic_at(self, q: Array) -> tuple[Array, float]:
        """Elastic force and energy at q."""

    def responses(
        self, inertia: float, drag: float, slope: Any, residual: Array
    ) -> tuple[Array, Array, Array]:
        """Solve (inertia M + drag Gamma + slope) [y, Z] = [-residual, B]; returns y (n,), Z (n, m),
        B^T Z (m, m).
        """

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


# Numba counts the references to every array of every tuple that is handed on, in atomic operations
# that took more than half of the time. So the compiled loop works with arrays that have no owner to
# count for: its caller holds them.


def borrowed(value):  # type: ignore[no-untyped-def]  # noqa: D103
    return value


def _without_owners(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    if isinstance(kind, types.BaseTuple):
        members = [
            _without_owners(context, builder, k, builder.extract_value(value, i))
            for i, k in enumerate(kind)
        ]
        return context.make_tuple(builder, kind, members)
    if isinstance(kind, types.Array):
        array = context.make_array(kind)(context, builder, value)
        array.meminfo = cgutils.get_null_value(array.meminfo.type)
        array.parent = cgutils.get_null_value(array.parent.type)
        return array._getvalue()
    return value


@intrinsic
def _borrow(typing_context, value):  # type: ignore[no-untyped-def]
    return value(value), lambda context, builder, _, arguments: _without_owners(
        context, builder, value, arguments[0]
    )


@overload(borrowed, jit_options={"forceinline": True})
def _borrowed(value):  # type: ignore[no-untyped-def]
    return lambda value: _borrow(value)


def _same_memory(result, arguments, aliases, argument_aliases):  # type: ignore[no-untyped-def]
    """Tell numba that to write to what is borrowed is to write to the argument, and not dead
    code.
    """
    ir_utils._add_alias(result, arguments[0].name, aliases, argument_aliases)


ir_utils.alias_func_extensions["borrowed", __name__] = _same_memory


# In compiled code a new array costs more than the arithmetic on these short vectors: they are
# written into room that is there.


def combine(out, *terms):  # type: ignore[no-untyped-def]
    """Write a x + b y + .. into out (n,), which may be one of the vectors; the terms are a, x, b,
    y, .. , at most three.
    """
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
    """Write a vector (n,) into out, element by element: compiled, a slice costs more than it
    copies.
    """
    for i in range(out.size):
        out[i] = vector[i]


def answer(out, y, unit, mean):  # type: ignore[no-untyped-def]
    """Write into out what the structure does: y (n,) and its response unit (n, P d) to the contact
    forces mean (P, d).
    """
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
