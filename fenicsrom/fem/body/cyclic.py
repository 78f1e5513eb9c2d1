"""A disk from one of its sectors: displacements that go around it as a wave.

The right cut face is the left one turned by α = ±360°/N about the axis, T is this turn. In a wave
with h nodal diameters each sector moves as the one before it, turned by |α| and with the phase h|α|
ahead. Its displacements on the right face, and those on the axis, follow from the others:

    u_R = e^{ihα} T W u_L,    u = e^{ihα} T u on the axis,    u = P v.                    (1)

W holds the shape functions of the left face at the nodes of the right one, turned back; a matching
mesh has ones. The face with more nodes follows the other one. Matrices of the sector, whose cut
faces are free, become those of the wave,

    Pᴴ K P,    Pᴴ M P,    Pᴴ G P.                                                       (2)

With h = 0 and N/2 they are real. Otherwise a + ib stands for [[a, −b], [b, a]], so that real
matrices have twice the size, and each mode comes twice. Source: Thomas, Int. J. Numer. Methods Eng.
14, 1979.
"""

from typing import Any, NamedTuple

import numpy as np
import scipy.linalg
import scipy.sparse
from numpy.typing import NDArray
from petsc4py import PETSc
from scipy.sparse import csr_array
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from fenicsrom.arrays import Array
from fenicsrom.errors import ErrorKind, SceneError, refuse
from fenicsrom.fem.base.linalg import Factorisation, FreeFactorisation, multiply
from fenicsrom.fem.body.pairs import Side
from fenicsrom.formats.mesh_file import Ints
from fenicsrom.scene import Cyclic
from fenicsrom.scene.base.rules import Where
from fenicsrom.words import counted

Complex = NDArray[np.complex128]

ON_AXIS = 1e-9
"""A node is on the axis if its distance from it, relative to the body, is smaller."""

BESIDE = 0.1
"""A node may lie beside all facets of the other face by this part of a facet, at curved rims."""

APART = 0.02
"""Largest distance of a node from the other face, turned, relative to its facet."""

WHOLE = 1e-3
"""A number of sectors is so near to an integer, relative to it."""

PART = 0.5
"""Supports may leave out this part of the following face."""

INDEPENDENT = 1e-6
"""Smaller shapes of a cut face, relative to the largest one, are not taken."""

ROUNDING = 1e-9
"""Smaller weights are the rounding of coordinates."""

RATIO = 2.0
"""The mesh of one cut face should not be finer than the other by a larger factor."""

NOTHING = 1e-6
"""A field has no rest if the square of the rest, relative to that of the field, is smaller."""

IMAGINARY = np.array([[0.0, -1.0], [1.0, 0.0]])


class _Masters(NamedTuple):
    """How the nodes (n,) follow from the masters of a wave: u_n = block_n v[columns_n].

    Attributes:
        block: (n, d, d) complex; zero columns belong to no master.
        columns: (n, d) global numbers of the masters.
    """

    block: Complex
    columns: Ints


class CutFaces:
    """The cut faces of a sector, and the constraints (1) of its body.

    Attributes:
        sectors: N.
        turn: (d, d) T.
        axis: unit vector (3,) of the axis.
        point: a point (3,) of the axis, m.
        angle: α, rad.
        marks: (nodes,) 1 on the leading face, 2 on the following one, else 0.
        sentence: what was found, for the user.
    """

    def __init__(self, body: Any, cyclic: Cyclic):
        """Find the nodes of the cut faces, and match them.

        Args:
            body: the body, whose supports are known.
            cyclic: the table of the scene.

        Raises:
            SceneError: a group is missing, the faces are not a turn of each other, or supports hold
                them differently.
        """
        self._body, self._cyclic = body, cyclic
        d = self._d = body.dimension
        self.sectors = cyclic.sectors
        self.axis = np.array(cyclic.axis or (0.0, 0.0, 1.0))
        self.point = np.pad(np.array(cyclic.point), (0, 3 - d))
        self._nodes = body.space.tabulate_dof_coordinates()[: body.local // d]
        self._first = body.space.dofmap.index_map.local_range[0]
        self._held = np.zeros((len(self._nodes), d), dtype=bool)
        self._held.reshape(-1)[body.clamped] = True
        away = np.linalg.norm(np.cross(self._nodes - self.point, self.axis), axis=1)
        self._central = np.flatnonzero(away < ON_AXIS * body.extent)
        names = cyclic.left, cyclic.right
        sides = [Side(body, body.mesh.facets(name)) for name in names]
        angle = self._angle(*sides)
        sizes = [len(np.unique(side.nodes)) for side in sides]
        fixed = [self._held[self._own(side.nodes)].sum() for side in sides]
        free = body.comm.allreduce(-np.array(fixed))
        if (sizes[0], free[0]) > (sizes[1], free[1]):  # left is then right, turned back
            sides, names, angle = sides[::-1], names[::-1], -angle
        self.angle, self.turn = angle, self.rotation(angle)[:d, :d]
        self.marks = np.zeros(len(self._nodes))
        for k, side in enumerate(sides):
            self.marks[self._own(side.nodes)] = 1.0 + k
        self._match(*sides, names)
        few, many = sorted(sizes)
        self.sentence = (
            f"one of {self.sectors} sectors: {many} nodes of {names[1]!r} follow {few} of "
            f"{names[0]!r}, turned by {np.degrees(angle):.4g}°; they lie at most "
            f"{self.distance:.2g} m beside it"
        )
        if many > RATIO ** (d - 1) * few:
            self.sentence += "; one face has a much finer mesh, which costs accuracy"

    def rotation(self, angle: float) -> Array:
        """The rotation (3, 3) about the axis by an angle, rad."""
        return np.asarray(Rotation.from_rotvec(angle * self.axis).as_matrix())

    def turned(self, points: Array, rotation: Array) -> Array:
        """Points (n, 3) after a rotation about the axis."""
        return np.asarray(self.point + (points - self.point) @ rotation.T)

    def beside(self, points: Array) -> list[Array]:
        """Points (n, 3) of both neighbouring sectors."""
        step = 2.0 * np.pi / self.sectors
        return [self.turned(points, self.rotation(angle)) for angle in (step, -step)]

    def _refused(self, key: str, value: object, allowed: str) -> SceneError:
        return Where(self._body.source, f"cyclic.{key}").refuse(value, allowed, ErrorKind.PLACE)

    def _angle(self, left: Side, right: Side) -> float:
        """The angle from the left face to the right one: ±360°/N."""
        arms = []
        for side in (left, right):
            arm = np.pad(side.middle.mean(axis=0), (0, 3 - self._d)) - self.point
            arms.append(arm - (arm @ self.axis) * self.axis)
        found = np.arctan2(self.axis @ np.cross(*arms), arms[0] @ arms[1])
        wanted = 2.0 * np.pi / self.sectors
        near = 2.0 * np.pi / max(abs(found), 1e-9)
        if round(near) != self.sectors:
            text = f"the cut faces enclose {np.degrees(abs(found)):.4g}° about the axis"
            if abs(near - round(near)) < WHOLE * near:
                text += f", as one of {round(near)} sectors does"
            allowed = f"{text}; look at cyclic.axis and cyclic.point, too"
            raise self._refused("sectors", self.sectors, allowed)
        return float(np.copysign(wanted, found))

    def _own(self, nodes: Ints) -> Ints:
        """The sorted local numbers of those of some nodes that this rank owns."""
        found = np.unique(nodes) - self._first
        return found[(found >= 0) & (found < len(self._nodes))]

    def _match(self, leader: Side, follower: Side, names: tuple[str, str]) -> None:
        """Find the weights of the leading nodes for each following one of this rank."""
        d, comm = self._d, self._body.comm
        self._followers = np.setdiff1d(self._own(follower.nodes), self._central)
        back = self.turned(self._nodes[self._followers], self.rotation(-self.angle))[:, :d]
        on, place, distance = leader.closest(back)
        lost = np.isinf(distance)  # beside a curved rim
        for found, more in zip(
            (on, place, distance), leader.closest(back[lost], BESIDE), strict=True
        ):
            found[lost] = more
        far = distance > APART * leader.size[on]
        away = cKDTree(leader.x.reshape(-1, d)).query(back)[0]
        distance = np.where(far, away, distance)
        self.distance = max(comm.allgather(float(np.max(distance, initial=0.0))))
        if failed := sum(comm.allgather(int(far.sum()))):
            allowed = (
                f"must be {names[0]!r} turned by {np.degrees(self.angle):.4g}°, but {failed} of "
                f"{counted(len(np.unique(follower.nodes)), 'node')} lie beside it, at most "
                f"{self.distance:.3g} m"
            )
            key = "right" if names[1] == self._cyclic.right else "left"
            raise self._refused(key, names[1], allowed)
        weights = leader.at(on, place)[2]
        self._weights = np.where(np.abs(weights) < ROUNDING, 0.0, weights)
        self._leaders = np.unique(leader.nodes)
        self._leading = np.searchsorted(self._leaders, leader.nodes[on])
        self._led = self._own(self._leaders)
        self._check_supports(names)

    def _check_supports(self, names: tuple[str, str]) -> None:
        """Check that supports hold the cut faces alike, and along directions that T keeps.

        They may leave out a part of the following face, as decks of CalculiX must.
        """
        d, comm = self._d, self._body.comm
        seam = self._held[np.union1d(self._central, np.flatnonzero(self.marks))]
        turned = np.einsum("ij,sj,lj->sil", self.turn, 1.0 * seam, self.turn)
        wrong = float(np.abs(turned - seam[:, :, None] * np.eye(d)).max(initial=0.0)) > ROUNDING
        led = self._of_leaders(1.0 * self._held)[self._leading]
        led = np.einsum("sk,skj->sj", self._weights, led)
        own = self._held[self._followers]
        missing = ~own & (led > 1.0 - ROUNDING)
        wrong |= bool(np.any(own & (led < 0.5)))
        wrong |= comm.allreduce(int(missing.sum())) > PART * comm.allreduce(missing.size)
        if self._body.slanted is not None:
            wrong |= bool(self.marks[self._body.slanted.nodes].any())
        if any(comm.allgather(wrong)):
            reason = (
                f"must hold {names[0]!r} and {names[1]!r} alike, in directions that the turn "
                "keeps: all components, that along the axis, or the other ones"
            )
            raise refuse(self._body.source, reason, ErrorKind.SUPPORT, "supports")

    def _of_leaders(self, values: NDArray[Any]) -> NDArray[Any]:
        """Values (l, ..) at all leading nodes from values (n, ..) at the nodes of this rank."""
        return np.concatenate(self._body.comm.allgather(values[self._led]))

    # ------------------------------------------------------------------ faces in few shapes

    @property
    def neighbour(self) -> int:
        """The leading face of sector j + neighbour is the following face of sector j."""
        return 1 if self.angle > 0.0 else -1

    def meet(self) -> bool:
        """Whether the cut faces meet on the axis. Collective."""
        return any(self._body.comm.allgather(self._central.size))

    def require_bore(self, what: str) -> None:
        """Check that the cut faces do not meet on the axis. Collective.

        Raises:
            SceneError: they do.
        """
        if self.meet():
            reason = f"must not meet on the axis in {what}: give the disk a bore"
            raise self._refused("left", self._cyclic.left, reason)

    def face_shapes(self, fields: Complex) -> Array:
        """Orthonormal shapes (l d, m) of the leading face that span parts of fields. Collective.

        Args:
            fields: (local, k) complex displacements; all real and imaginary parts weigh alike.

        Raises:
            SceneError: the cut faces meet on the axis, or supports hold them everywhere.
        """
        self.require_bore("a disk in time")
        parts = np.concatenate([fields.real, fields.imag], axis=1)
        found = self._of_leaders(parts.reshape(-1, self._d, parts.shape[1]))
        found = found.reshape(-1, parts.shape[1])
        if not found.any():
            reason = "must not be held everywhere by supports in a disk in time"
            raise self._refused("left", self._cyclic.left, reason)
        sizes = np.linalg.norm(found, axis=0)
        kept = sizes > INDEPENDENT * sizes.max(initial=0.0)
        shapes, values, _ = np.linalg.svd(found[:, kept] / sizes[kept], full_matrices=False)
        return np.asarray(shapes[:, values > INDEPENDENT * values[0]])

    def coordinates(self, shapes: Array, fields: Complex) -> Complex:
        """Coordinates (m, k) of fields (local, k) on the leading face in its shapes (l d, m)."""
        found = self._of_leaders(fields.reshape(-1, self._d, fields.shape[1]))
        return np.asarray(shapes.T @ found.reshape(-1, fields.shape[1]))

    def lifted(self, shapes: Array) -> Array:
        """Shapes (l d, m) on the leading face, then turned on the following one: (local, 2 m)."""
        n, d, m = *self._held.shape, shapes.shape[1]
        nodes, found = shapes.reshape(-1, d, m), np.zeros((n, d, 2, m))
        found[self._led, :, 0] = nodes[np.searchsorted(self._leaders, self._led + self._first)]
        led = nodes[self._leading]
        found[self._followers, :, 1] = np.einsum("ij,sk,skjm->sim", self.turn, self._weights, led)
        found[self._held] = 0.0
        return found.reshape(n * d, 2 * m)

    # ------------------------------------------------------------------ waves

    def is_real(self, h: int) -> bool:
        """Whether the wave with h nodal diameters has real matrices of single size."""
        return 2 * h in (0, self.sectors)

    def constraint(self, h: int) -> PETSc.Mat:
        """P of (1) for h nodal diameters. Collective.

        Returns:
            (local, masters) if h is 0 or N/2, else (2 local, 2 masters): real and imaginary parts
            follow each other.
        """
        phase, comm = np.exp(1j * h * self.angle), self._body.comm
        masters, count = self._masters(h)
        led = _Masters(*(self._of_leaders(part) for part in masters))
        d, k = self._d, self._followers
        values = phase * np.einsum(
            "ij,sk,skjm->skim", self.turn, self._weights, led.block[self._leading]
        )
        values *= ~self._held[k][:, None, :, None]
        columns = np.broadcast_to(led.columns[self._leading][:, :, None, :], values.shape)
        rows = np.broadcast_to((d * k[:, None] + np.arange(d))[:, None, :, None], values.shape)
        own = np.broadcast_to(masters.columns[:, None, :], masters.block.shape)
        unknowns = np.arange(masters.block.shape[0] * d).reshape(-1, d, 1)
        at = np.broadcast_to(unknowns, masters.block.shape)
        entries = [(masters.block, at, own), (values, rows, columns)]
        data, row, column = (
            np.concatenate([part.ravel() for part in parts]) for parts in zip(*entries, strict=True)
        )
        kept = np.abs(data) > ROUNDING**2
        size = comm.allreduce(count)
        found = scipy.sparse.coo_array(
            (data[kept], (row[kept], column[kept])), shape=(self._body.local, size)
        ).tocsr()
        if self.is_real(h):
            return _petsc(csr_array(found.real), count, comm)
        return _petsc(paired(found), 2 * count, comm)

    def displacements(self, h: int, z: Complex) -> Complex:
        """Complex amplitudes u (local, k) of Re (u e^{iωt}) of masters (own, k). Collective."""
        constraint = self.constraint(h)
        parts = (np.ascontiguousarray(part, dtype=np.float64) for part in (z.real, z.imag))
        real, imaginary = (multiply(constraint, part) for part in parts)
        constraint.destroy()
        found = real + 1j * imaginary
        return np.asarray(found if self.is_real(h) else found[::2])

    def masters_of(self, h: int, fields: Complex) -> Array:
        """The masters (own, k), as of `constraint`, of waves (local, k)."""
        block, k = self._masters(h)[0].block, fields.shape[1]
        found = np.einsum("nim,nik->nmk", block.conj(), fields.reshape(*block.shape[:2], k))
        found = found[np.any(np.abs(block) > ROUNDING, axis=1)]
        if self.is_real(h):
            return np.asarray(found.real)
        return np.stack([found.real, found.imag], axis=1).reshape(2 * len(found), k)

    def waves_among(self, h: int, fields: Array) -> Complex:
        """Combinations (local, m) of independent fields (local, k) that are waves. Collective."""
        constraint = self.constraint(h)
        wave = multiply(constraint, self.masters_of(h, fields))
        constraint.destroy()
        rest = fields - (wave if self.is_real(h) else wave[::2] + 1j * wave[1::2])
        return self._without(rest, fields)

    def shifts_among(self, fields: Complex) -> Complex:
        """Combinations (local, m) of fields (local, k) that are translations. Collective."""
        nodes = fields.reshape(*self._held.shape, fields.shape[1])
        count, total = map(self._body.comm.allreduce, (len(nodes), nodes.sum(axis=0)))
        return self._without((nodes - total / count).reshape(fields.shape), fields)

    def _without(self, rest: Complex, fields: Complex) -> Complex:
        """Combinations (local, m) of independent fields (local, k) that have no rest (local, k)."""
        if not fields.shape[1]:
            return fields
        errors, sizes = (self._body.comm.allreduce(x.conj().T @ x) for x in (rest, fields))
        values, vectors = scipy.linalg.eigh(errors, sizes)
        return np.asarray(fields @ vectors[:, values < NOTHING])

    def turning(self, motions: Array, u: Array) -> Array:
        """What displacements u (local,) add to rigid motions (local, k) that turn the disk."""
        d = self._d
        arms, moved = (
            np.cross(self.axis, np.pad(x, ((0, 0), (0, 3 - x.shape[1]))))[:, :d].ravel()
            for x in (self._nodes - self.point, u.reshape(-1, d))
        )
        turned, size = map(self._body.comm.allreduce, (arms @ motions, arms @ arms))
        return np.outer(moved, turned / size)

    def _masters(self, h: int) -> tuple[_Masters, int]:
        """How the nodes of this rank follow from masters, but for the followers; their number."""
        n, d = self._held.shape
        block = np.zeros((n, d, d), dtype=complex)
        block[:, range(d), range(d)] = ~self._held
        block[self._central] = 0.0
        block[self._followers] = 0.0
        if h < 2:  # other waves hold the axis; these leave its direction, or turn about it
            first, second = scipy.linalg.null_space(self.axis[None]).T
            second *= np.sign(self.axis @ np.cross(first, second))
            fixed = self.axis if h == 0 else (first + 1j * second) / np.sqrt(2.0)
            block[self._central, :, 0] = ~self._held[self._central] * fixed[:d]
        used = np.any(np.abs(block) > ROUNDING, axis=1)
        count = int(used.sum())
        columns = np.zeros((n, d), dtype=np.int64)
        columns[used] = (self._body.comm.exscan(count) or 0) + np.arange(count)
        return _Masters(block, columns), count


def paired(matrix: Any) -> csr_array:
    """A sparse complex matrix a + ib for real and imaginary parts that follow each other."""
    real, imaginary = (
        scipy.sparse.kron(part, pattern)
        for part, pattern in ((matrix.real, np.eye(2)), (matrix.imag, IMAGINARY))
    )
    return csr_array(real + imaginary)


def _petsc(local: csr_array, columns: int, comm: Any) -> PETSc.Mat:
    """A PETSc matrix from its rows on this rank, with the columns that this rank owns."""
    local.sort_indices()
    starts, places = (a.astype(PETSc.IntType) for a in (local.indptr, local.indices))
    sizes = (local.shape[0], None), (columns, None)
    return PETSc.Mat().createAIJ(sizes, csr=(starts, places, local.data), comm=comm)


def wave_matrix(
    matrix: PETSc.Mat, constraint: PETSc.Mat, more: csr_array | None = None
) -> PETSc.Mat:
    """The matrix (2) of a wave from a matrix of the sector and P. Collective.

    `more`, sparse (local, size), is added first to the matrix, or to the two copies of it that P
    has of a wave in real and imaginary parts.
    """
    size = matrix.getLocalSize()[0], matrix.getSize()[1]
    copies = constraint.getLocalSize()[0] // size[0]
    if copies == 1 and more is None:
        return matrix.ptap(constraint)
    starts, columns, values = matrix.getValuesCSR()
    rows = csr_array((values, columns, starts), shape=size)
    double = scipy.sparse.kron(rows, np.eye(copies), format="csr")
    if more is not None:
        double = double + more
    pair = _petsc(csr_array(double), copies * size[0], matrix.comm.tompi4py())
    found = pair.ptap(constraint)
    pair.destroy()
    return found


class WaveFactorisation:
    """P (Pᵀ K P)⁻¹ Pᵀ of a matrix K of the sector, in place of K⁻¹, for loads alike on all sectors.

    Attributes:
        matrix: K.
    """

    def __init__(self, body: Any, matrix: PETSc.Mat, prefix: str, symmetric: bool = True):
        """Factorise a matrix of a body; other arguments and errors as `Factorisation`."""
        cut: CutFaces = body.cut
        self.matrix, self._constraint = matrix, cut.constraint(0)
        inner = wave_matrix(matrix, self._constraint)
        self._inner: Factorisation | FreeFactorisation
        if body.rigid.shape[1]:
            mass, rigid = wave_matrix(body.mass, self._constraint), cut.masters_of(0, body.rigid)
            self._inner = FreeFactorisation(inner, rigid.real, mass, prefix)
            mass.destroy()
        else:
            self._inner = Factorisation(inner, prefix, symmetric)

    def update(self) -> None:
        """Factorise again after the values of the matrix changed."""
        self.matrix.ptap(self._constraint, self._inner.matrix)
        self._inner.update()

    def solve(self, block: Array) -> Array:
        """Solve for every column of a block (local, k)."""
        inner = self._inner.solve(times_transposed(self._constraint, block))
        return multiply(self._constraint, inner)

    def negative_eigenvalues(self) -> int:
        """Number of negative eigenvalues of Pᵀ K P."""
        return self._inner.negative_eigenvalues()

    def destroy(self, matrix: bool = False) -> None:
        """Free the factors, and the matrix too if asked. Collective."""
        self._inner.destroy(matrix=True)
        if matrix:
            self.matrix.destroy()


def times_transposed(matrix: PETSc.Mat, block: Array) -> Array:
    """The transposed of a rectangular matrix times a block (rows of this rank, k)."""
    y, x = matrix.createVecs()
    found = np.empty((y.getLocalSize(), block.shape[1]))
    for k in range(block.shape[1]):
        x.array[:] = block[:, k]
        matrix.multTranspose(x, y)
        found[:, k] = y.array
    x.destroy()
    y.destroy()
    return found
