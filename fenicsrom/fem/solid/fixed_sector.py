"""A sector of a disk in few coordinates.

    u = u₀ + R η + Ψ y + Ψ′ y′,    Ψ = W − K_c⁻¹ K W                                      (1)

R is the basis of the sector with both cut faces clamped, an ordinary body: normal modes, their
derivatives, responses to loads and static modes of its contacts. W are a few shapes of the leading
face, and the same shapes turned on the following one; K_c is the stiffness K with clamped faces, so
that Ψ carries the sector along without a force inside. The shapes are those of the lowest waves
with few nodal diameters, which serve the diameters in between (Craig and Bampton, AIAA J. 6, 1968,
with an interface in few modes).

A contact between sectors has two sides, which move on their own in the interior: R has the
responses of both to the forces of the contact.
"""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Self

import numpy as np
import scipy.sparse

from fenicsrom.arrays import Array
from fenicsrom.fem.body.cyclic import Complex
from fenicsrom.fem.body.stress_points import stress_table
from fenicsrom.fem.mesh.mesh import Mesh
from fenicsrom.fem.solid.solid import KnownEquilibrium, Solid, solid_of
from fenicsrom.fem.solid.wave import wave
from fenicsrom.formats.mesh_file import Marks
from fenicsrom.notes import packed
from fenicsrom.online.contact.points import ContactPoints
from fenicsrom.online.model.disk_model import (
    Sector,
    deviations,
    disk_model,
    disk_scene,
    load_diameters,
    require_families,
)
from fenicsrom.online.motion.motion import Motion, attempted
from fenicsrom.online.run.simulate import simulate
from fenicsrom.online.store.disk import StoredDisk
from fenicsrom.online.store.scene_changes import Trained
from fenicsrom.online.store.store import provenance
from fenicsrom.reduction.basis import ReducedBasis, project
from fenicsrom.reduction.derivatives import all_pairs
from fenicsrom.reduction.interface import MORE, VECTORS
from fenicsrom.reduction.stages import Reduction, Timer
from fenicsrom.reduction.training import train
from fenicsrom.scene import Scene, Support
from fenicsrom.scene.base.rules import BY_MOTION
from fenicsrom.scene.keys.excitation import HIGHEST_MODE

WAVES = 3
"""Number of modes of each nodal diameter whose shapes the cut faces take."""

INDEPENDENT = 1e-6
"""A combination of contact forces joins others if they leave out more than this part of it."""

PAIRED = 3
"""Number of normal modes of the sector with clamped faces whose derivatives the basis takes."""

FURTHER = 4
"""Number of further normal modes of the larger sector, which judges the reduction.

The larger sector also has one more mode of each nodal diameter, and derivatives of one more normal
mode.
"""


def wave_diameters(scene: Scene) -> list[int]:
    """The nodal diameters that shape the cut faces: 0, 1, 2, N/2, and those of the loads."""
    assert scene.cyclic is not None
    n = scene.cyclic.sectors
    return sorted({0, 1, min(2, n // 2), n // 2} | load_diameters(scene))


def stored_disk(scene: Scene, mesh: Mesh, timed: Timer) -> StoredDisk:
    """Reduce the sector of a scene, and judge its waves. Collective.

    Args:
        scene: a scene with the table [cyclic].
        mesh: the mesh of a sector.
        timed: gives a context that times the stage of a name.

    Raises:
        SceneError: as `solid_of`; or the cut faces meet on the axis.
        ConvergenceError, AccuracyError: as `solid_of` and, with `interface` vectors that motions
            choose, `train`; or the modes were not found.
    """
    with timed("solid"):
        body = solid_of(scene, mesh)
    assert body.cut is not None
    trained: Trained | None = None
    with _Cut(body, scene, timed) as cut:
        if scene.basis.masters == "motion":
            with timed("motions that choose interface vectors"):
                trained = train(body, scene, lambda _: [cut.motion()], [scene])
        basis = cut.basis()
        sector, vectors = cut.reduced(WAVES, basis)
        larger = cut.reduced(WAVES + 1, cut.larger_basis(basis))[0]
    with timed("waves of the mesh"):
        checked = wave_error(body, scene, sector)
    table = None
    if scene.output.stresses != "none" or scene.output.motion:
        with timed("stress points"):
            table = stress_table(body, scene, body.equilibrium, vectors)
    return StoredDisk(
        sector=sector,
        larger=larger,
        scene=scene,
        dofs=body.free,
        extent=body.extent,
        diameters=tuple(wave_diameters(scene)),
        wave_error=checked,
        highest_hz=body.excitation,
        sentence=body.cut.sentence,
        table=table,
        trained=trained,
        notes=packed(body.warnings),
        provenance=provenance(),
    )


def clamped(scene: Scene) -> Scene:
    """The scene of a sector, whose supports hold its cut faces, too."""
    cyclic = scene.cyclic
    assert cyclic is not None
    clamps = Support(group=cyclic.left), Support(group=cyclic.right)
    return replace(scene, supports=(*scene.supports, *clamps))


def clamped_interior(sector: Solid, scene: Scene) -> Solid:
    """The ordinary body that a sector is with clamped cut faces, about its equilibrium."""
    known = KnownEquilibrium(sector.equilibrium, 0, displaced=True)
    interior = Solid(sector.mesh, clamped(scene), known)
    interior.cut = None  # its faces are held: it has no waves
    return interior


class _Cut:
    """A sector with its waves, and the ordinary body that it is with clamped cut faces."""

    def __init__(self, sector: Solid, scene: Scene, timed: Timer):
        """Compute the waves, and clamp the faces. Collective."""
        self._sector, self._scene, self._timed = sector, scene, timed
        cyclic = scene.cyclic
        assert sector.cut is not None and cyclic is not None
        with timed("waves"):
            waves = {h: _lowest_waves(sector, h) for h in wave_diameters(scene)}
        self._shapes = {}
        for count in (WAVES, WAVES + 1):
            copies = {h: count * (1 if sector.cut.is_real(h) else 2) for h in waves}
            fields = [field[:, : copies[h]] for h, field in waves.items()]
            self._shapes[count] = sector.cut.face_shapes(np.concatenate(fields, axis=1))
        self._clamped = clamped(scene)
        self._interior = clamped_interior(sector, scene)
        self._part_contacts()

    def __enter__(self) -> Self:
        """The sector itself."""
        return self

    def __exit__(self, *error: object) -> None:
        """Release the memory."""
        self._interior.destroy()

    def _part_contacts(self) -> None:
        """Let both sides of contacts between sectors move on their own in the interior."""
        interior, points = self._interior, self._sector.between
        self._between = np.repeat(points, interior.dimension)
        rows = interior.contact_rows - interior.ahead_rows, interior.ahead_rows[self._between]
        interior.contact_rows = scipy.sparse.vstack(rows, format="csr")
        interior.points = ContactPoints._make(
            np.concatenate([part, part[points]]) for part in interior.points
        )
        if interior.joint is not None:
            springs = np.where(self._between, 0.0, interior.joint.springs)
            interior.joint = interior.joint._replace(springs=springs)

    def motion(self) -> Motion:
        """The motion of the disk of the basis, up to a failure if there is one."""
        whole = disk_scene(self._scene)
        model = disk_model(self.reduced(WAVES, self.basis())[0], whole, deviations(whole))
        return attempted(lambda: simulate(model, whole))[0]

    def basis(self) -> ReducedBasis:
        """The basis of the interior, with the present `interface` vectors of the sector."""
        options = self._scene.basis
        modes = options.modes if isinstance(options.modes, int) else PAIRED
        return self._basis(options.modes, min(PAIRED, modes), options.masters)

    def _basis(self, modes: int | str, paired: int, masters: int | str | None) -> ReducedBasis:
        """The basis of the interior.

        Args:
            modes: number of normal modes, or "auto".
            paired: number of them whose derivatives the basis takes.
            masters: as `basis.masters`.
        """
        if self._sector.interface is not None:
            self._interior.interface = both_sides(self._sector.interface, self._between)
        options = replace(self._scene.basis, modes=modes, masters=masters)
        if options.derivatives in BY_MOTION:  # a sector alone moves otherwise
            labels = all_pairs([f"{k + 1}V" for k in range(paired)])
            options = replace(options, derivatives=tuple(labels))
        held = replace(self._clamped, basis=options)
        return Reduction(self._interior, held, self._timed).basis

    def larger_basis(self, basis: ReducedBasis) -> ReducedBasis:
        """The basis of the interior of the larger sector; `basis` is the one that it judges."""
        modes = sum(re.fullmatch(r"\d+V", label) is not None for label in basis.labels)
        most, masters = min(modes + FURTHER, self._interior.free), self._scene.basis.masters
        if masters == "motion" and self._interior.interface is not None:
            masters = VECTORS + MORE
        return self._basis(most, min(PAIRED + 1, most), masters)

    def reduced(self, waves: int, basis: ReducedBasis) -> tuple[Sector, Array]:
        """The sector with so many waves of each diameter, and its displacements (local, n)."""
        sector, cut, interior = self._sector, self._sector.cut, self._interior
        assert cut is not None
        shapes = self._shapes[waves]
        faces = cut.lifted(shapes)
        faces -= interior.factor.solve(interior.without_held(sector.stiffness_times(faces)))
        with self._timed("reduction"):
            own = project(interior, basis, self._scene.geometrically_nonlinear).elastic
            whole = replace(basis, vectors=np.concatenate([basis.vectors, faces], axis=1))
            model = project(sector, whole, nonlinear=False)
        ahead = sector.comm.allreduce(sector.ahead_rows @ whole.vectors)
        springs = np.zeros(len(ahead)) if sector.joint is None else sector.joint.springs
        found = Sector(model, own, shapes.shape[1], cut.neighbour, ahead, springs)
        require_families(found, self._scene)
        return found, whole.vectors


def both_sides(vectors: Array, between: Marks) -> Array:
    """Combinations of contact forces (m, k) of both sides of contacts, one after the other.

    Args:
        vectors: the combinations.
        between: (m,) whether the second side moves on its own, with rows behind the m first.
    """
    m, b = between.size, int(between.sum())
    found = np.zeros((m + b, 0))
    for vector in vectors.T:
        for column in (np.append(vector, np.zeros(b)), np.append(np.zeros(m), vector[between])):
            rest = column - found @ np.linalg.lstsq(found, column)[0]
            if np.linalg.norm(rest) > INDEPENDENT * np.linalg.norm(vector):
                found = np.column_stack([found, column])
    return found


def wave_error(body: Solid, scene: Scene, sector: Sector) -> tuple[int, float]:
    """Compare waves of a reduced sector with those of the mesh. Collective.

    Returns:
        A nodal diameter between those that shape the cut faces, and the largest relative error of
        its frequencies in the range of the loads, at least of two.
    """
    assert scene.cyclic is not None
    n, known = scene.cyclic.sectors, wave_diameters(scene)
    between = [h for h in range(n // 2 + 1) if h not in known] or known
    h = between[len(between) // 2]
    found = sector.wave_frequencies(h, n)
    count = max(2, int(np.sum(found < HIGHEST_MODE * body.excitation)))
    with wave(body, h) as exact:
        copies = 2 if exact.double else 1
        count = min(count, exact.free // copies)
        squares = exact.eigenmodes(exact.factor, copies * count)[0][::copies]
    wanted = np.sqrt(squares) / (2.0 * np.pi)
    return h, float(np.max(np.abs(found[:count] / wanted - 1.0)))


def _lowest_waves(sector: Solid, h: int) -> Complex:
    """Displacements (local, k) of the lowest waves with h nodal diameters.

    A wave that goes around comes twice; both together have its real and its imaginary part.
    """
    assert sector.cut is not None
    with wave(sector, h) as body:
        count = min((WAVES + 1) * (2 if body.double else 1), body.free)
        modes = body.eigenmodes(body.factor, count)[1]
    return sector.cut.displacements(h, modes.astype(complex))
