"""One model for a range of speeds of rotation, exact in Ω.

About the unloaded shape, u = R q, a body that turns at Ω obeys

    M q̈ + (α M + D + Ω G) q̇ + f(q) − Ω² (c + Q q) = p(t) − Bᵀ F,    (1)

with the cubic elastic force f, the centrifugal force Ω² (c + Q q) and the Coriolis force −Ω G q̇ of
`fenicsrom.fem.body.rotation`; nothing else depends on Ω. The *range model* is (1) on the joined
basis of some speeds (`fenicsrom.reduction.joined`). It is too large for a time integration: the
cost of its force grows with n⁴. At one speed it is therefore reduced a second time, without the
mesh. The equilibrium q_Ω solves f(q) = Ω² (c + Q q) under the static loads, and with the tangent T
there

    q = q_Ω + Z y,    Z = [R_m, Φ, θ],    (2)

where R_m, Φ and θ are the interface modes, the normal modes and the modal derivatives of the range
model, each v of them as v − R_m Bᵀ v (`fenicsrom.reduction.basis`). The model on (2) is exact on
its subspace, and is one like any other. A larger model judges it: more modes, static responses to
the loads, and combinations of the derivatives along interface modes.

Bodies that touch are brought together without friction at each speed
(`fenicsrom.online.contact.together`). The springs of their closed points belong to T, but not to f.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations_with_replacement
from typing import Any, NamedTuple

import numpy as np
import scipy.linalg

from fenicsrom.arrays import Array
from fenicsrom.errors import ConvergenceError
from fenicsrom.online.contact.points import closed_springs
from fenicsrom.online.contact.surfaces import Contacts
from fenicsrom.online.contact.together import sliding
from fenicsrom.online.kernels.dense import interpolation_weights
from fenicsrom.online.model.loads import static_factors
from fenicsrom.online.model.model import ReducedModel
from fenicsrom.online.model.polynomial import ElasticPolynomial, paired_cubic, unique_cubic
from fenicsrom.online.model.subspace import (
    change_of_tangent,
    nested_model,
    projected,
    shifted,
    subspace_model,
)
from fenicsrom.online.model.turning import Turning, rest_row
from fenicsrom.online.step.statics import (
    dense_newton,
    force_and_tangent,
    in_load_steps,
    together,
)

NEXT_MODES = 3
"""Normal modes of the larger model above those of the model."""

NEXT_INTERFACE_MODES = 10
"""Interface modes of the larger model beyond those of the model, if not all directions are."""

COMBINATIONS = 8
"""Combinations of the derivatives along interface modes in the larger model."""

DEPENDENCE = 1e-7
"""A vector is left out if its independent part, relative to its norm, is at most this."""

ITERATIONS = 30
"""Largest number of Newton iterations of an equilibrium."""

SNAPSHOTS = 25
"""Speeds of which a model for a varying speed is made."""

RUN_UP = {"equilibrium": 1e-4, "modes": 1e-3, "attached": 2e-2, "derivatives": 3e-2}
"""Smallest singular value of its proper orthogonal modes, relative to the largest."""

FURTHER = 10.0
"""The larger model that judges it has modes of singular values smaller by this factor.

With a factor of 3, three of the six further modes of a blade joined its model, and the other three
gave an estimate thirty times too small."""

SMALLEST_STEP = 1.0 / 64.0
"""Smallest step of the centrifugal and static loads, relative to the loads."""


@dataclass(frozen=True, eq=False)
class AtSpeed:
    """The range model at one speed, reduced.

    Attributes:
        model: the model of n coordinates.
        candidates: the larger model that judges it; its first n coordinates are those of the model.
        labels: (n,) labels of the coordinates.
        further: labels of the other coordinates of the larger model.
        frequencies_hz: (v,) natural frequencies of the normal modes of the basis, Hz.
    """

    model: ReducedModel
    candidates: ReducedModel
    labels: tuple[str, ...]
    further: tuple[str, ...]
    frequencies_hz: Array


class _Snapshot(NamedTuple):
    """What a range model of n coordinates shows at one speed.

    Attributes:
        tangent: (n, n) at the equilibrium.
        equilibrium: (n, 1)
        modes: (n, v) normal modes.
        attached: (n, m) attachment modes of the masters.
        derivatives: (n, v (v + 1) / 2) modal derivatives, of modes with the elastic energy 1/2 J.
    """

    tangent: Array
    equilibrium: Array
    modes: Array
    attached: Array
    derivatives: Array


class RangeErrors(NamedTuple):
    """Errors of a range model against the solid at speeds between those of its basis.

    Attributes:
        speeds: (k,) rad/s.
        displacement: (k,) of the equilibrium, relative, in the mass norm.
        frequency: (k,) the largest relative error of a natural frequency.
        flexibility: (k,) of the flexibility of the masters, relative, in the Frobenius norm; zero
            without contact.
    """

    speeds: Array
    displacement: Array
    frequency: Array
    flexibility: Array


@dataclass(frozen=True, eq=False)
class RangeModel:
    """The model (1) on the joined basis of some speeds.

    Attributes:
        model: the model at rest about the unloaded shape, of n coordinates; its first coordinates
            are the displacements of the masters.
        centrifugal: (n,) c, kg m.
        softening: (n, n) Q, kg.
        coriolis: (n, n) G, kg; (0, 0) without the Coriolis force.
        euler: (n,) g of the Euler force (`online.model.turning`), kg m.
        inertia: (1,) moment of inertia about the axis at rest, kg m².
        moments: (loads, 1 + n) moment of each unit load about the axis, and its derivative by q, m.
        speeds: (s,) speeds of the basis, ascending, rad/s.
        equilibria: (s, n) coordinates of the equilibria at these speeds.
        modes: number of normal modes of a model at one speed.
        masters: number of master displacements.
        errors: the errors between the speeds.
        contacts: the contacts that hold bodies which touch; None of other bodies.
        finer: the range model of finer elements, which judges the mesh at each speed; None if
            there is none.
    """

    model: ReducedModel
    centrifugal: Array
    softening: Array
    coriolis: Array
    euler: Array
    inertia: Array
    moments: Array
    speeds: Array
    equilibria: Array
    modes: int
    masters: int
    errors: RangeErrors
    contacts: Contacts | None = None
    finer: RangeModel | None = None

    def under(self, **changes: Any) -> RangeModel:
        """The range model, and that of finer elements, under other loads or another damping."""
        finer = None if self.finer is None else self.finer.under(**changes)
        return replace(self, model=self.model._replace(**changes), finer=finer)

    def squares(self, omega: float) -> Array:
        """omega_i^2 (v,) of the normal modes at a speed in rad/s, rad^2/s^2.

        Raises:
            ConvergenceError: there is no equilibrium.
        """
        found = self.tangent(omega, self.equilibrium(omega))
        return self._lowest(found)

    def _lowest(self, tangent: Array) -> Array:
        """omega_i^2 (v,) of the normal modes with a tangent (n, n)."""
        squares = scipy.linalg.eigh(tangent, self.model.mass, eigvals_only=True)
        return np.asarray(squares[: self.modes])

    def oriented(self, z: Array) -> Array:
        """Vectors (n, k) with the sign that makes their largest observed displacement positive.

        The models of two meshes then have coordinates of the same sign. Displacements are observed
        at the contact points and at the probe, or along the loads of a model without both.
        """
        model = self.model
        rows = np.concatenate([model.contact_rows, model.probe])
        seen = (rows if rows.size else model.loads.T) @ z
        if not seen.size:
            return z
        largest = seen[np.argmax(np.abs(seen), axis=0), np.arange(z.shape[1])]
        return np.asarray(z * np.where(largest < 0.0, -1.0, 1.0))

    def velocity_matrix(self, omega: float) -> Array:
        """D + Ω G (n, n) at a speed in rad/s; (0, 0) without both."""
        parts = [a for a in (self.model.velocity_matrix, omega * self.coriolis) if a.size]
        return np.sum(parts, axis=0) if parts else np.zeros((0, 0))

    def elastic(self, omega: float, part: float = 1.0) -> ElasticPolynomial:
        """f(q) − part Ω² (c + Q q) at a speed in rad/s."""
        elastic, square = self.model.elastic, part * omega**2
        return elastic._replace(
            force=elastic.force - square * self.centrifugal,
            stiffness=elastic.stiffness - square * self.softening,
        )

    def tangent(self, omega: float, q: Array) -> Array:
        """The tangent (n, n) at an equilibrium q (n,), with the springs of closed points."""
        return force_and_tangent(self.elastic(omega), q)[1] + self.springs(q)

    def springs(self, q: Array) -> Array:
        """The stiffness (n, n) of the contact points that are closed at an equilibrium q (n,)."""
        rows, contacts = self.model.contact_rows, self.contacts
        if contacts is None:
            return np.zeros_like(self.model.mass)
        found = closed_springs(contacts, self.model.contact_offset + rows @ q)
        return np.asarray((rows.T * found) @ rows)

    def equilibrium(self, omega: float) -> Array:
        """q_Ω (n,) at a speed in rad/s, under the static loads.

        Newton's method starts at the polynomial in Ω² through the equilibria of the basis, or, if
        it does not converge from there, follows the equilibrium from rest. Bodies that touch have
        the first way only.

        Raises:
            ConvergenceError: there is no equilibrium.
        """
        start = interpolation_weights([*self.speeds**2], omega**2) @ self.equilibria
        if self.contacts is not None:
            model = self.model._replace(elastic=self.elastic(omega))
            x = model.contact_offset + model.contact_rows @ start
            return together(model, self.contacts, sliding(self.contacts, x), start)
        found = self._newton(start, omega, 1.0)
        if found is not None:
            return found
        found, reached = in_load_steps(
            np.zeros(self.model.size), lambda q, part: self._newton(q, omega, part), SMALLEST_STEP
        )
        if reached < 1.0:
            speed = 30.0 / np.pi * omega
            raise ConvergenceError(
                f"no equilibrium at {speed:.6g} rpm: the range model lost it at "
                f"{reached:.3g} of the centrifugal and static loads",
                found,
            )
        return found

    def _newton(self, start: Array, omega: float, part: float) -> Array | None:
        """The equilibrium (n,) under a part of all loads from a start (n,), or None."""
        static = self.model.loads @ static_factors(self.model.load_histories)
        load = part * (static + omega**2 * self.centrifugal)
        turning = self.elastic(omega, part)._replace(force=self.model.elastic.force)
        return dense_newton(start, partial(force_and_tangent, turning), load, ITERATIONS)

    def at(self, omega: float, interface_modes: bool, nonlinear: bool) -> AtSpeed:
        """The models on (2) at a speed in rad/s.

        Args:
            omega: the speed, rad/s.
            interface_modes: whether the masters are the interface modes at this speed; otherwise
                they are those of the basis.
            nonlinear: False gives linear models about the equilibrium, without derivatives.

        Raises:
            ConvergenceError: there is no equilibrium.
        """
        q0, elastic = self._about(omega, nonlinear)
        space = _Space(self, elastic, q0)
        squares, z, labels, count = space.basis(interface_modes)
        whole = self._on(z, q0, elastic, self.velocity_matrix(omega))
        return _at_speed(whole, labels, count, squares[: self.modes])

    def _on(self, z: Array, q0: Array, elastic: ElasticPolynomial, velocity: Array) -> ReducedModel:
        """The model on q = q0 + Z y with an elastic force about q0, exactly symmetric."""
        reduced, n = projected(elastic, z), z.shape[1]
        reduced = reduced._replace(cubic=paired_cubic(unique_cubic(reduced.cubic, n), n))
        return subspace_model(self.model, reduced, q0, z, velocity)

    def _snapshot(self, omega: float) -> _Snapshot:
        """What the model shows at a speed in rad/s."""
        q, n = self.equilibrium(omega), self.model.size
        tangent, elastic = self.tangent(omega, q), self.elastic(omega)
        squares, modes = scipy.linalg.eigh(
            tangent, self.model.mass, subset_by_index=(0, self.modes - 1)
        )
        along = (modes / np.sqrt(np.abs(squares))).T
        both = [[force_and_tangent(elastic, q + sign * x)[1] for sign in (1, -1)] for x in along]
        changes = [0.5 * (plus - minus) for plus, minus in both]
        bent = [changes[i] @ along[j] for i in range(self.modes) for j in range(i + 1)]
        solved = np.linalg.solve(tangent, np.column_stack([np.eye(n, self.masters), *bent]))
        return _Snapshot(
            tangent, q[:, None], modes, solved[:, : self.masters], solved[:, self.masters :]
        )

    def over(self, history: Array, omega: float) -> AtSpeed:
        """The models for a speed that varies, about the equilibrium at its start.

        The vectors are proper orthogonal modes of what the range model shows at `SNAPSHOTS` speeds:
        equilibria, normal modes, attachment modes of the masters, and modal derivatives. The last
        two are not scaled, in the energy norm: those that matter hold more energy. In the mass norm
        the stretching that lets a bent body bend on would not count.

        Args:
            history: (r, 3) the speeds (`fenicsrom.online.contact.surfaces`).
            omega: the speed of the natural frequencies, rad/s.

        Raises:
            ConvergenceError: there is no equilibrium at one of the speeds.
        """
        model, n, q0 = self.model, self.model.size, self.equilibrium(history[0, 1])
        ends = np.min(history[:, 1]) ** 2, np.max(history[:, 1]) ** 2
        squares = np.unique(np.linspace(*ends, SNAPSHOTS))  # a single one of a constant speed
        shown = [self._snapshot(float(speed)) for speed in np.sqrt(squares)]
        first: dict[str, Array] = {}
        further: dict[str, Array] = {}
        middle = shown[len(shown) // 2].tangent
        for kind, accuracy in RUN_UP.items():
            inner = model.mass if kind in ("equilibrium", "modes") else middle
            block = np.concatenate([getattr(one, kind) for one in shown], axis=1)
            vectors, sizes = _proper(block, inner, accuracy / FURTHER)
            count = int(np.sum(sizes > accuracy * np.max(sizes, initial=0.0)))
            first |= _named(vectors[:, :count], kind[0].upper())
            further |= _named(vectors[:, count:], kind[0].upper(), count)
        free = np.zeros((n, 0))
        z, labels, count = _orthonormalised(model.mass, free, free.T, first | further, len(first))
        z = self.oriented(z)
        damping = model.velocity_matrix if model.velocity_matrix.size else np.zeros((n, n))
        whole = self._on(z, q0, shifted(model.elastic, q0), damping)
        turning = self._turning(history, q0, z)
        rest = []
        for square, one in zip(map(float, squares), shown, strict=True):
            q = z.T @ model.mass @ (one.equilibrium[:, 0] - q0)
            rest.append(rest_row(turning, whole.elastic, square, q))
        table = np.array(rest)
        if self.contacts is not None and squares.size > 2:  # their forces change the energy, too
            table[:, 2] = np.gradient(table[:, 1], squares, edge_order=2)
        whole = whole._replace(turning=turning._replace(rest=table))
        found = self.tangent(omega, self.equilibrium(omega))
        return _at_speed(whole, labels, count, self._lowest(found))

    def _turning(self, history: Array, q0: Array, z: Array) -> Turning:
        """The data of a varying speed in q = q0 + Z y, without the energies at rest."""
        coriolis = self.coriolis if self.coriolis.size else np.zeros_like(self.softening)
        turned, softened = 0.5 * coriolis @ q0, self.softening @ q0
        moments = self.moments
        return Turning(
            history=history,
            centrifugal=z.T @ (self.centrifugal + softened),
            softening=z.T @ self.softening @ z,
            coriolis=z.T @ coriolis @ z,
            euler=z.T @ (self.euler + turned),
            inertia=float(self.inertia[0] + (2.0 * self.centrifugal + softened) @ q0),
            moments=np.column_stack([moments[:, 0] + moments[:, 1:] @ q0, moments[:, 1:] @ z]),
            rest=np.zeros((0, 3)),
        )

    def vectors(
        self, omega: float, interface_modes: bool, nonlinear: bool
    ) -> tuple[Array, dict[str, Array]]:
        """q_Ω (n,), and the columns (n,) of Z and of the larger model by label; as `at`."""
        q0, elastic = self._about(omega, nonlinear)
        _, z, labels, _ = _Space(self, elastic, q0).basis(interface_modes)
        return q0, dict(zip(labels, z.T, strict=True))

    def _about(self, omega: float, nonlinear: bool) -> tuple[Array, ElasticPolynomial]:
        """q_Ω (n,) and the elastic force about it; arguments and errors as `at`."""
        q0 = self.equilibrium(omega)
        elastic = shifted(self.elastic(omega), q0)
        if not nonlinear:
            elastic = elastic._replace(quadratic=np.zeros((0, 0)), cubic=np.zeros((0, 0)))
        return q0, elastic


class _Space:
    """The vectors of (2) in a range model about its equilibrium."""

    def __init__(self, whole: RangeModel, elastic: ElasticPolynomial, q0: Array):
        """Store the range model, and its elastic force about the equilibrium q0 (n,)."""
        self.whole, self.elastic = whole, elastic
        self.mass, self.tangent = whole.model.mass, elastic.stiffness + whole.springs(q0)

    def solve(self, block: Array) -> Array:
        """T⁻¹ times a block (n, k)."""
        return np.asarray(np.linalg.solve(self.tangent, block), np.float64)

    def basis(self, interface_modes: bool) -> tuple[Array, Array, tuple[str, ...], int]:
        """Z and the vectors of the larger model.

        Returns:
            ω² of the normal modes, the vectors (n, k), their labels, and how many are those of Z.
        """
        whole, n = self.whole, self.mass.shape[0]
        squares, modes = scipy.linalg.eigh(self.tangent, self.mass)
        v, m = whole.modes, whole.masters
        rows: Array = np.eye(m, n)
        more: Array = np.zeros((0, n))
        if interface_modes or whole.contacts is not None:
            given = whole.model.contact_rows
            flexibility = given @ self.solve(given.T)
            ahead = np.linalg.eigh(0.5 * (flexibility + flexibility.T))[1].T[::-1] @ given
            if interface_modes:
                rows, ahead = ahead[:m], ahead[m:]
            more = ahead[:NEXT_INTERFACE_MODES]
        attached = self.solve(np.concatenate([rows, more]).T)
        static = attached[:, :m] @ np.linalg.inv(rows @ attached[:, :m])
        named = _named(modes[:, :v], "V")
        nonlinear = self.elastic.quadratic.size > 0
        if nonlinear:
            named |= self.derivatives(named, named)
        size = len(named)
        named |= _named(modes[:, v : v + NEXT_MODES], "V", v)
        named |= _named(attached[:, m:], "S", m)
        named |= _named(self.solve(whole.model.loads), "A")
        if nonlinear and m:
            named |= self.combined(modes[:, :v], static)
        z, labels, kept = _orthonormalised(self.mass, static, rows, named, size)
        z[:, m:] = whole.oriented(z[:, m:])
        return squares, z, labels, m + kept

    def derivatives(self, one: dict[str, Array], other: dict[str, Array]) -> dict[str, Array]:
        """θ = −T⁻¹ T′[x] y of all pairs of some vectors (n,) by their labels, each pair once."""
        named = {**one, **other}
        pairs = [pair for pair in combinations_with_replacement(named, 2) if {*pair} & {*other}]
        changes = {label: change_of_tangent(self.elastic, named[label]) for label, _ in pairs}
        found = self.solve(np.array([changes[a] @ named[b] for a, b in pairs]).T)
        return {a + b: -found[:, k] for k, (a, b) in enumerate(pairs)}

    def combined(self, modes: Array, static: Array) -> dict[str, Array]:
        """The combinations of derivatives along interface modes that hold the most energy.

        All vectors have the same elastic energy.
        """
        along = _named(self.with_unit_energy(modes), "V")
        across = _named(self.with_unit_energy(static), "S")
        found = np.array(list(self.derivatives(along, across).values())).T
        gram = found.T @ self.tangent @ found
        axes = np.linalg.eigh(0.5 * (gram + gram.T))[1][:, ::-1][:, :COMBINATIONS]
        return _named(found @ axes, "D")

    def with_unit_energy(self, block: Array) -> Array:
        """Vectors (n, k) scaled to the elastic energy 1/2 J."""
        return block / np.sqrt(np.abs(np.sum(block * (self.tangent @ block), axis=0)))


def _orthonormalised(
    mass: Array, static: Array, rows: Array, named: dict[str, Array], size: int
) -> tuple[Array, tuple[str, ...], int]:
    """R_m, then the vectors v − R_m Bᵀ v, orthonormal in the mass norm.

    Args:
        mass: (n, n) M.
        static: (n, m) R_m.
        rows: (m, n) Bᵀ.
        named: the vectors (n,) by their labels.
        size: number of the vectors that belong to Z.

    Returns:
        The vectors (n, k), their labels, and how many of the first ones were kept.
    """
    kept: list[Array] = []
    labels: list[str] = []
    count = 0
    for number, (label, vector) in enumerate(named.items()):
        x = vector / np.sqrt(vector @ mass @ vector)
        x = x - static @ (rows @ x)
        for _ in range(2):  # the second pass removes the rounding errors of the first
            for y in kept:
                x = x - y * (y @ mass @ x)
        rest = np.sqrt(x @ mass @ x)
        if rest <= DEPENDENCE:
            continue
        x = x / rest
        x = x - static @ (rows @ x)  # the division has amplified rounding errors
        kept.append(x)
        labels.append(label)
        count += number < size
    masters = tuple(f"{k + 1}S" for k in range(static.shape[1]))
    return np.column_stack([static, *kept]), (*masters, *labels), count


def _proper(snapshots: Array, inner: Array, accuracy: float) -> tuple[Array, Array]:
    """The proper orthogonal modes (n, k) of snapshots (n, s) in an inner product (n, n).

    Args:
        snapshots: the snapshots.
        inner: the inner product.
        accuracy: smallest singular value of a mode, relative to the largest.
    """
    squares, weights = np.linalg.eigh(snapshots.T @ inner @ snapshots)
    sizes = np.sqrt(np.maximum(squares[::-1], 0.0))
    kept = sizes > accuracy * np.max(sizes, initial=0.0)
    return snapshots @ weights[:, ::-1][:, kept] / sizes[kept], sizes[kept]


def _at_speed(whole: ReducedModel, labels: tuple[str, ...], count: int, squares: Array) -> AtSpeed:
    """The first `count` coordinates of a model as one, judged by all of them."""
    model = nested_model(whole, range(count))
    frequencies = np.sqrt(np.maximum(squares, 0.0)) / (2.0 * np.pi)
    return AtSpeed(model, whole, labels[:count], labels[count:], frequencies)


def _named(block: Array, kind: str, first: int = 0) -> dict[str, Array]:
    """The columns (n,) of a block (n, k) by their labels, such as 1V."""
    return {f"{first + k + 1}{kind}": block[:, k] for k in range(block.shape[1])}
