"""Comparisons with other models: the full model, finer elements and the 1D beam.

How well the modes of a reduced model agree with those of the full model.

Both sets are free vibrations about the equilibrium without contact, damping and Coriolis forces.
The modal assurance criterion (Allemang and Brown 1982) of a full mode φᵢ and a reduced mode ψⱼ is

    MACᵢⱼ = (φᵢᵀ M ψⱼ)² / ((φᵢᵀ M φᵢ) (ψⱼᵀ M ψⱼ)).    (1)

It is 1 for the same shape and 0 for shapes without a common part. With the mass matrix M as the
weight it does not depend on the density of the nodes, and its sum over all reduced modes is the
part of the kinetic energy of φᵢ that the basis can represent.

Estimated errors of frequencies and deflections due to the mesh.

`fenicsrom.assess.errors.estimates.mesh_errors` judges motions. Where there are none, of modes,
Campbell diagrams, static equilibria and curves, the natural frequencies and the deflection of the
probe are compared with those of elements of one degree more. An estimate is `MESH_SAFETY` times the
relative difference.

Whether the 1D beam of a scene stands for its solid: a comparison of linear properties.

The table [reference.beam_section] repeats what the mesh and the places of the scene say. If one of
them changes and the other does not, the beam is another structure. The first natural frequency and
the displacements at the loads and at the observed place then differ between beam and solid.

The residual indicator: the error of a basis without a run of the full model.

At some steps of the steady state the balance of the full model's own time step is evaluated at the
reduced motion, with its contact forces. The residual r is zero where the basis contains the full
motion. Its size is measured by the work that it does on the linear structure, relative to the work
of the load amplitude p,

    indicator = sqrt(mean_k r_k^T K^-1 r_k / p^T K^-1 p),

which is the energy norm of the displacement that the residual would cause in the linear structure.
The indicator has no unit. This measure does not depend on the mesh, or on the ratio of stiff axial
to soft transverse forces. The plain norm |r|/|p| depends on both, and is computed only to compare
how well the two norms rank the bases.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.assess.errors.estimates import MESH_SAFETY
from fenicsrom.assess.errors.verdicts import FREQUENCY_ERROR, check_error, finer_mesh, in_percent
from fenicsrom.errors import AccuracyError, ConvergenceError, ErrorKind, SceneError, refuse
from fenicsrom.notes import Note, NoteKind
from fenicsrom.online.model.loads import largest
from fenicsrom.online.motion.motion import Motion
from fenicsrom.online.step.state import no_state, scheme
from fenicsrom.online.step.step import step_coefficients, write_residual
from fenicsrom.online.store.archive import StoredModel
from fenicsrom.reduction.basis import ReducedBasis
from fenicsrom.reduction.beam import beam_structure
from fenicsrom.reduction.derivatives import combinations
from fenicsrom.reduction.modes import ComponentModes
from fenicsrom.reduction.protocols import Structure
from fenicsrom.scene import Scene

if TYPE_CHECKING:
    from fenicsrom.fem.solid.finer import FinerSolid
    from fenicsrom.fem.solid.solid import Solid


MOST_COMPARED = 12
"""Largest number of modes of the full model that are compared."""


@dataclass(frozen=True, eq=False)
class ModeAgreement:
    """Modes of the full and of the reduced model.

    Attributes:
        full_hz: (k,) the lowest natural frequencies of the full model, Hz.
        reduced_hz: (size,) all natural frequencies of the reduced model, Hz.
        mac: (k, size) modal assurance criterion (1).
    """

    full_hz: Array
    reduced_hz: Array
    mac: Array

    @property
    def partners(self) -> list[int]:
        """The reduced mode that is most similar to each full mode."""
        return [int(j) for j in np.argmax(self.mac, axis=1)]

    @property
    def represented(self) -> Array:
        """(k,) part of the kinetic energy of each full mode that the basis can represent."""
        return np.asarray(self.mac.sum(axis=1))


def mode_agreement(structure: Structure, vectors: Array) -> ModeAgreement:
    """Compare the modes of a reduced basis with those of its structure. Collective.

    As many modes as the basis has vectors are compared, at most `MOST_COMPARED`.

    Args:
        structure: the structure.
        vectors: (local, size) vectors of the basis.

    Raises:
        ConvergenceError: the eigensolver did not find all modes of the structure.
        AccuracyError: a mode failed its residual check.
    """
    import scipy.linalg  # slow to import, and runs of stored models compare no modes

    size = vectors.shape[1]
    squares, full = structure.eigenmodes(structure.factor, min(size, MOST_COMPARED))
    stiffness = structure.inner(vectors, structure.held_times(vectors))
    both = (0.5 * (a + a.T) for a in (stiffness, structure.mass_inner(vectors, vectors)))
    reduced_squares, shapes = scipy.linalg.eigh(*both)
    products = structure.mass_inner(full, vectors) @ shapes
    sizes = np.diag(structure.mass_inner(full, full))
    mac = products**2 / sizes[:, None]  # eigh gives ψᵀ M ψ = 1
    full_hz, reduced_hz = (
        np.sqrt(np.maximum(found, 0.0)) / (2.0 * np.pi) for found in (squares, reduced_squares)
    )
    return ModeAgreement(full_hz, reduced_hz, mac)


IN_A_NODE = 1e-6
"""A probe that moves by a smaller part of the largest displacement has no relative error."""


@dataclass(frozen=True)
class MeshCheck:
    """Estimated relative errors due to the mesh.

    Attributes:
        frequencies: those of the natural frequencies of the structure's modes 1, 2, ..
        deflection: that of the static deflection of the probe; None without one.
        missing: why they are not estimated; empty if they are.
        labels: of the frequencies, if they are not those of the modes 1, 2, ..
    """

    frequencies: tuple[float, ...] = ()
    deflection: float | None = None
    missing: str = ""
    labels: tuple[str, ...] = ()

    def sentence(self) -> str:
        """The estimates in words; empty without any."""
        listed = [in_percent(error) for error in self.frequencies]
        said = [f"of the natural frequencies {', '.join(listed)}"] if listed else []
        if self.labels and listed:
            worst = int(np.argmax(self.frequencies))
            said = [
                f"of the natural frequencies at most {listed[worst]} (mode {self.labels[worst]})"
            ]
        if self.deflection is not None:
            said.append(f"of the static deflection {in_percent(self.deflection)}")
        return f"Estimated error due to the mesh: {'; '.join(said)}." if said else ""

    def warnings(self, scene: Scene, quantity: str = "") -> list[Note]:
        """One note if there is no estimate, or a frequency is too wrong; else none.

        Args:
            scene: the scene, for the remedy.
            quantity: what wrong frequencies cast doubt on; all by default.
        """
        if self.missing:
            text = f"the error due to the mesh is not estimated: {self.missing}"
            return [Note(NoteKind.UNCHECKED, text)]
        worst = max(self.frequencies, default=0.0)
        if worst <= FREQUENCY_ERROR:
            return []
        at = self.frequencies.index(worst)
        mode = self.labels[at] if self.labels else at + 1
        text = (
            f"the mesh is too coarse: elements of degree {scene.geometry.degree + 1} change the "
            f"frequency of mode {mode} by {in_percent(worst / MESH_SAFETY)}: "
            f"{finer_mesh(scene, 2.0 * worst)}"
        )
        return [Note(NoteKind.ERROR, text, "geometry", quantity=quantity)]

    def failure(self, scene: Scene) -> AccuracyError | None:
        """The error of a static deflection that is too wrong, or None.

        Args:
            scene: the scene, for the remedy.
        """
        try:
            check_error(scene, "mesh", self.deflection or 0.0)
        except AccuracyError as error:
            return error
        return None


def of_solid(
    scene: Scene,
    solid: Solid,
    squares: tuple[Array, Callable[[Solid], Array]] | None = None,
    deflection: Callable[[Solid], Array] | None = None,
    further: Callable[[FinerSolid], None] = lambda finer: None,
) -> MeshCheck:
    """Compare results of a solid with those of finer elements. Collective.

    Args:
        scene: the scene of the solid.
        solid: the solid.
        squares: omega^2 (v,) of the natural frequencies, rad^2/s^2, and what gives those of the
            finer solid.
        deflection: gives the displacement (local,) of a solid, m.
        further: what else the finer solid is needed for.
    """
    from fenicsrom.fem.solid.finer import FinerSolid, too_large

    reason = too_large(solid)
    if reason is not None:
        return MeshCheck(missing=reason)
    try:
        finer = FinerSolid(scene, solid)
        ours, theirs = squares or (np.zeros(0), lambda finer: np.zeros(0))
        frequencies = _of_squares(ours, theirs(finer)[: ours.size])
        # finer elements keep the contact points, on which the deflection of a joint depends
        moved = None
        if deflection is not None and not scene.joined:
            moved = _moved(deflection, solid, finer)
        further(finer)
        finer.destroy()
    except (AccuracyError, ConvergenceError, SceneError) as error:
        return MeshCheck(missing=str(error))
    return MeshCheck(frequencies, moved)


def of_model(stored: StoredModel, *speeds_rpm: float) -> MeshCheck:
    """The estimated errors of the natural frequencies of a stored model.

    Args:
        stored: the model. A superelement has no estimates: its matrices do not know the mesh.
        speeds_rpm: of a model for a range of speeds, the largest errors at these speeds are taken;
            by default the speed of its scene counts.
    """
    if stored.unjudged:
        return MeshCheck(missing=stored.unjudged)
    whole, rotation = stored.whole, stored.scene.rotation
    if whole is None or rotation is None:
        better = stored.finer_frequencies_hz
        return MeshCheck(_relative(stored.frequencies_hz[: better.size], better))
    if whole.finer is None:
        return MeshCheck()
    found = []
    try:
        for omega in np.pi / 30.0 * np.array(speeds_rpm or [rotation.speed_rpm]):
            found.append(_of_squares(whole.squares(omega), whole.finer.squares(omega)))
    except ConvergenceError as error:
        return MeshCheck(missing=str(error))
    return MeshCheck(tuple(max(errors) for errors in zip(*found, strict=True)))


def _of_squares(squares: Array, better: Array) -> tuple[float, ...]:
    """Estimated errors of frequencies, from omega^2 (v,) of the mesh and of finer elements."""
    ours, theirs = (np.sqrt(np.maximum(value, 0.0)) for value in (squares, better))
    return _relative(ours, theirs)


def _relative(ours: Array, theirs: Array) -> tuple[float, ...]:
    """Estimated errors of frequencies (v,) of the mesh, from those of finer elements."""
    apart = MESH_SAFETY * np.abs(ours - theirs) / np.where(theirs > 0.0, theirs, np.inf)
    return tuple(float(value) for value in apart)


def _moved(deflection: Callable[[Solid], Array], solid: Solid, finer: Solid) -> float | None:
    """The estimated error of a deflection of the probe; None where the probe stands still."""
    probes, largest = [], 0.0
    for body in (solid, finer):
        found = deflection(body)
        probes.append(np.asarray(body.comm.allreduce(body.probe_rows @ found)))
        largest = max(largest, float(body.largest(found[:, None])[0]))
    size = float(np.linalg.norm(probes[1]))
    if size <= IN_A_NODE * largest:
        return None
    return MESH_SAFETY * float(np.linalg.norm(probes[0] - probes[1])) / size


AGREEMENT = 0.05
"""Largest relative difference; a slender solid on a usual mesh is within 1 %."""


def check_beam(body: Structure, scene: Scene) -> None:
    """Check that the beam of a scene agrees with its solid. Collective.

    Args:
        body: the solid.
        scene: its scene, with a reference beam.

    Raises:
        SceneError: the beam differs from the solid, or cannot be made of this scene.
    """
    ours, theirs = _properties(body), _properties(beam_structure(scene))
    for name, value in ours.items():
        apart = float(np.linalg.norm(value - theirs[name]))
        if apart > AGREEMENT * float(np.linalg.norm(value)):
            reason = (
                f"the beam does not stand for the solid: {name} is {_shown(theirs[name])} of the "
                f"beam and {_shown(value)} of the solid (at most {100.0 * AGREEMENT:g} % "
                "difference is accepted); give the length, height, width and load_at of the mesh, "
                "or set reference.beam = false"
            )
            raise refuse(scene.source, reason, ErrorKind.MISMATCH, "reference.beam_section")


def _shown(values: Array) -> str:
    """Numbers for a message."""
    return ", ".join(f"{value:.4g}" for value in values)


def _properties(body: Structure) -> dict[str, Array]:
    """Linear properties of a structure by their names, of loads of size 1."""
    squares, _ = body.eigenmodes(body.factor, 1)
    under_loads = body.factor.solve(body.load_vectors)
    at_loads = np.sum(body.load_vectors * under_loads, axis=0)
    at_probe = (body.probe_rows @ under_loads).ravel()
    return {
        "the first natural frequency in Hz": np.sqrt(np.abs(squares)) / (2.0 * np.pi),
        "the flexibility at the loads in m/N": body.comm.allreduce(at_loads),
        "the displacement of the observed place by 1 N in m": body.comm.allreduce(at_probe),
    }


INSTANTS = 16  # steps of the last period at which the residual is taken


def residuals(body: Structure, vectors: Array, motion: Motion, scene: Scene) -> Array:
    """Residuals of the full model's time step along the last period of a reduced motion.

    Args:
        body: the solid or the beam.
        vectors: (local, n) the basis R.
        motion: the reduced motion, with the coordinates of its last period.
        scene: the scene of the motion.

    Returns:
        (local, k) residuals at `INSTANTS` steps, N.
    """
    from fenicsrom.fem.full.full import full_model  # slow to import

    model = full_model(body)
    plan = scheme(scene.time.scheme, model, scene.time.spectral_radius or 0.0)
    assert motion.coordinates is not None and motion.coordinate_time is not None
    assert motion.velocity is not None and motion.acceleration is not None
    time, count = motion.coordinate_time, motion.coordinate_time.size
    first = motion.time.size - count
    state = no_state(vectors.shape[0], 0, 1)
    trial, found = state.trial, []
    for k in _instants(motion):
        state.q[:] = vectors @ motion.coordinates[k]
        state.v[:] = vectors @ motion.velocity[k]
        state.a[:] = vectors @ motion.acceleration[k]
        trial.dq[:] = vectors @ (motion.coordinates[k + 1] - motion.coordinates[k])
        at = step_coefficients(plan, plan.damping, time[k + 1] - time[k])
        trial.inertia_offset[:] = at.inertia_v * state.v + at.inertia_a * state.a
        trial.external_force[:] = (1.0 - plan.alpha_f) * model.load(time[k + 1])
        trial.external_force[:] += plan.alpha_f * model.load(time[k])
        model.set_interval(time[k], time[k])
        if plan.start_weight:
            state.elastic_force[:] = model.elastic_at(state.q)[0]
        model.set_interval(time[k], time[k + 1])
        elastic, _ = model.elastic_over_step(
            state.elastic_force, state.q, trial.dq, plan.start_weight, plan.points, plan.weights
        )
        write_residual(model, plan, state, at, elastic)
        force = motion.mean_force[first + k + 1].reshape(-1)
        found.append(trial.residual + body.contact_rows.T @ force)
    return np.array(found).T


def _instants(motion: Motion) -> NDArray[np.int64]:
    """The steps of the last period, by their starts, at which the residual is taken."""
    assert motion.coordinate_time is not None
    last = motion.coordinate_time.size - 2
    return np.unique(np.linspace(0, last, INSTANTS).round().astype(np.int64))


def unseen(
    body: Structure, modes: ComponentModes, basis: ReducedBasis, motion: Motion, scene: Scene
) -> tuple[Array, Array]:
    """Static responses K^-1 r to the residuals along a motion, outside of the basis of the motion.

    Args:
        body: the solid or the beam.
        modes: its component modes.
        basis: the basis of the motion.
        motion: the motion, with the coordinates of its last period.
        scene: the scene of the motion.

    Returns:
        The principal responses (local, k), the largest elastic energy first, and the square roots
        of these energies (k,), relative to the mean elastic energy of the motion.
    """
    found = modes.inverse.solve(residuals(body, basis.vectors, motion, scene))
    vectors, energies = combinations(body, modes, basis, found / np.sqrt(found.shape[1]))
    assert motion.coordinates is not None
    moved = basis.vectors @ motion.coordinates[_instants(motion)].T
    energy = np.mean(np.diag(body.inner(moved, body.held_times(moved))))
    return vectors, np.sqrt(energies / energy) if energy > 0.0 else np.zeros(energies.size)


def indicators(
    body: Structure, vectors: Array, motion: Motion, scene: Scene
) -> tuple[float | None, float | None]:
    """Root mean squares of the residual, relative to the amplitude of the loads.

    Returns:
        The value in the energy norm, and the value in the plain norm; None without loads that vary.
    """
    found = residuals(body, vectors, motion, scene)
    varying = [not load.static for load in scene.loads]
    factors = np.where(varying, largest(body.load_histories), 0.0)
    loads = np.abs(body.load_vectors) @ factors[:, None]

    def sizes(block: Array) -> tuple[Array, ...]:
        work = block * body.factor.solve(block), block**2
        return tuple(body.comm.allreduce(np.sum(part, axis=0)) for part in work)

    energy, plain = (
        float(np.sqrt(np.mean(size) / load[0])) if load[0] > 0.0 else None
        for size, load in zip(sizes(found), sizes(loads), strict=True)
    )
    return energy, plain
