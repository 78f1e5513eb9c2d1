"""Factorisations and eigenmodes by PETSc and SLEPc, on arrays of the unknowns of this rank."""

from collections.abc import Callable
from typing import Any

import numpy as np
import scipy.linalg
from petsc4py import PETSc
from scipy.sparse import csr_array
from scipy.sparse.linalg import ArpackError, LinearOperator, eigsh
from slepc4py import SLEPc

from fenicsrom.arrays import Array
from fenicsrom.errors import AccuracyError, ConvergenceError, ErrorKind
from fenicsrom.reduction.protocols import Inverse
from fenicsrom.words import counted

SINGULAR = (-6, -10)  # errors of MUMPS; all others are about resources
EIGEN_TOLERANCE = 1e-10
SPARE_VECTORS = 10  # Krylov vectors beyond the modes: with fewer of them restarts cost more
# largest backward error of a mode, |K^-1 M phi - phi/omega^2| omega_1^2 in the mass norm; a slender
# body has a condition number of 1e11
EIGEN_CHECK = 1e-8


class Factorisation:
    """A factorised matrix.

    The factors are L D Lᵀ, or L U of a matrix that is not symmetric. MUMPS computes the factors;
    for a small matrix, PETSc itself computes them.
    """

    SMALL = 1000  # with fewer unknowns PETSc's factorisation is faster than MUMPS

    def __init__(
        self, matrix: PETSc.Mat, prefix: str, symmetric: bool = True, counting: bool = False
    ):
        """Factorise; `prefix` names its PETSc options, such as -prefix_mat_mumps_icntl_14.

        Raises:
            ConvergenceError: as `update`.
        """
        self.matrix = matrix
        self.comm = matrix.comm.tompi4py()
        self._ksp = PETSc.KSP().create(matrix.comm)
        self._ksp.setOptionsPrefix(prefix + "_")
        self._ksp.setType(PETSc.KSP.Type.PREONLY)
        pc = self._ksp.getPC()
        self._small = matrix.getSize()[0] < self.SMALL and self.comm.size == 1
        # Both solvers use LDL^T, whose inverse is symmetric to the last digit: the modes are then
        # accurate to 1e-12. With LU they are accurate to 1e-6 only.
        matrix.setOption(PETSc.Mat.Option.SYMMETRIC, symmetric)
        pc.setType(PETSc.PC.Type.CHOLESKY if symmetric else PETSc.PC.Type.LU)
        if not self._small:
            pc.setFactorSolverType("mumps")
        pc.setFactorPivot(np.finfo(float).tiny)  # PETSc's default of 2e-14 N/m is not relative
        self._ksp.setFromOptions()
        # MUMPS counts negative pivots only if it also looks for zero pivots
        if counting and not self._small:
            self._ksp.setOperators(matrix)
            pc.setFactorSetUpSolverType()
            pc.getFactorMatrix().setMumpsIcntl(24, 1)
        self._vectors = matrix.createVecs()
        self.update()

    def update(self) -> None:
        """Factorise again after the values of the matrix changed.

        Raises:
            ConvergenceError: the matrix is singular, or there is too little memory.
        """
        self._ksp.setOperators(self.matrix)
        pc = self._ksp.getPC()
        try:
            self._ksp.setUp()
            failed = pc.getFailedReason() != 0
        except PETSc.Error:
            failed = True
        if not failed:
            return
        status = 0 if self._small else pc.getFactorMatrix().getMumpsInfog(1)
        if status < 0 and status not in SINGULAR:
            raise ConvergenceError(
                f"MUMPS could not factorise the stiffness matrix of {self.matrix.getSize()[0]} "
                f"unknowns (error {status}): there is too little memory, most likely",
                kind=ErrorKind.MEMORY,
            )
        raise ConvergenceError("the stiffness matrix is singular: a pivot is zero")

    def destroy(self, matrix: bool = False) -> None:
        """Free the factors, and the matrix too if asked; PETSc frees nothing itself in parallel."""
        for part in (self._ksp, *self._vectors, *([self.matrix] if matrix else [])):
            part.destroy()

    @property
    def negative_pivots(self) -> int:
        """Number of negative pivots of a symmetric matrix; the factor is `counting`."""
        return int(self._ksp.getPC().getFactorMatrix().getInertia()[0])

    def negative_eigenvalues(self) -> int:
        """Number of negative eigenvalues of the symmetric matrix, by Sylvester's law of inertia.

        MUMPS on one rank counts the negative pivots of every factor; otherwise another factor is
        made to count them.
        """
        if self._small or self.comm.size > 1:
            return negative_eigenvalues(self.matrix)
        return int(self._ksp.getPC().getFactorMatrix().getMumpsInfog(12))

    def solve(self, block: Array) -> Array:
        """Solve for every column of a block.

        Args:
            block: (local rows, k) right-hand sides.

        Returns:
            (local rows, k) solutions.
        """
        if self._small or block.shape[1] < 2:
            x, b = self._vectors
            out = np.empty_like(block)
            for k in range(block.shape[1]):
                b.array[:] = block[:, k]
                self._ksp.solve(b, x)
                out[:, k] = x.array
            return out
        b, x = _dense(self.matrix, block), _dense(self.matrix, np.zeros(block.shape, order="F"))
        self._ksp.matSolve(b, x)
        return _values(x, b)


class FreeFactorisation:
    """The inverse stiffness of a free body, on the complement of its rigid motions.

        K⁺ = P K_d⁻¹ Pᵀ,    P = I − R Rᵀ M.

    R are the rigid motions, mass-orthonormal. In K_d as many unknowns are held as there are rigid
    motions. Pᵀ f is in balance, so that the held unknowns take no force: K⁺ f is the deformation of
    the body that a force f accelerates, without a rigid part (inertia relief: Craig and Chang, AIAA
    Paper 77-405, 1977).

    Attributes:
        matrix: K.
    """

    def __init__(self, matrix: PETSc.Mat, rigid: Array, mass: PETSc.Mat, prefix: str):
        """Factorise K_d.

        Args:
            matrix: K, symmetric.
            rigid: (local rows, r) R.
            mass: M.
            prefix: as `Factorisation`.

        Raises:
            ConvergenceError: as `Factorisation.update`.
        """
        self.matrix, self._rigid, self._inertia = matrix, rigid, multiply(mass, rigid)
        self._comm, count = matrix.comm.tompi4py(), rigid.shape[1]
        own = scipy.linalg.qr(rigid.T, mode="r", pivoting=True)[1][:count]
        first = matrix.getOwnershipRange()[0]
        numbers = np.concatenate(self._comm.allgather(first + own))
        motions = np.concatenate(self._comm.allgather(rigid[own]))
        held = np.sort(numbers[scipy.linalg.qr(motions.T, mode="r", pivoting=True)[1][:count]])
        self._held = held.astype(PETSc.IntType)
        local = held - first
        self._own = local[(local >= 0) & (local < len(rigid))]
        self._inner = Factorisation(self._held_matrix(matrix.copy()), prefix)

    def _held_matrix(self, matrix: PETSc.Mat) -> PETSc.Mat:
        """K_d in place of K."""
        matrix.zeroRowsColumns(self._held, self.matrix.norm(PETSc.NormType.INFINITY))
        return matrix

    def update(self) -> None:
        """Factorise again after the values of the matrix changed; errors as `Factorisation`."""
        self.matrix.copy(self._inner.matrix, structure=PETSc.Mat.Structure.SAME_NONZERO_PATTERN)
        self._held_matrix(self._inner.matrix)
        self._inner.update()

    def solve(self, block: Array) -> Array:
        """K⁺ times the columns of a block (local rows, k)."""
        balanced = block - self._inertia @ self._comm.allreduce(self._rigid.T @ block)
        balanced[self._own] = 0.0
        found = self._inner.solve(balanced)
        return np.asarray(found - self._rigid @ self._comm.allreduce(self._inertia.T @ found))

    def negative_eigenvalues(self) -> int:
        """Number of negative eigenvalues of K."""
        return self._inner.negative_eigenvalues()

    def destroy(self, matrix: bool = False) -> None:
        """Free the factors, and the matrix too if asked. Collective."""
        self._inner.destroy(matrix=True)
        if matrix:
            self.matrix.destroy()


def negative_eigenvalues(matrix: PETSc.Mat) -> int:
    """Number of negative eigenvalues of a symmetric matrix, by Sylvester's law of inertia.

    Raises:
        ConvergenceError: the matrix is singular.
    """
    factor = Factorisation(matrix, "fenicsrom_inertia", counting=True)
    count = factor.negative_pivots
    factor.destroy()
    return count


def multiply(matrix: PETSc.Mat, block: Array) -> Array:
    """Matrix times a vector (local columns,) or the columns of a block (local columns, k).

    The ranks exchange all columns at once.
    """
    if block.ndim == 1:
        x, y = matrix.createVecs()
        x.array[:] = block
        matrix.mult(x, y)
        found = y.array.copy()
    else:
        x = _dense(matrix, block)
        return _values(matrix.matMult(x), x)
    x.destroy()
    y.destroy()
    return np.asarray(found)


def _dense(matrix: PETSc.Mat, block: Array) -> PETSc.Mat:
    """A block (local columns, k) as a dense matrix with the distribution of the columns."""
    rows = matrix.getLocalSize()[1], matrix.getSize()[1]
    sizes = rows, (None, block.shape[1])
    dense = PETSc.Mat().createDense(sizes, array=np.asfortranarray(block), comm=matrix.comm)
    dense.assemble()
    return dense


def _values(result: PETSc.Mat, *others: PETSc.Mat) -> Array:
    """The block (local, k) in a dense matrix, which is destroyed, as are the others.

    The block may have no rows on this rank.
    """
    rows, columns = result.getLocalSize()[0], result.getSize()[1]
    values = np.zeros((rows, columns), order="F")
    if rows:
        values[:] = result.getDenseArray()
    for matrix in (result, *others):
        matrix.destroy()
    return values


class _Preconditioner:
    """Hands an `Inverse` to PETSc as a preconditioner."""

    def __init__(self, inverse: Inverse):
        self.inverse = inverse

    def apply(self, pc: PETSc.PC, x: PETSc.Vec, y: PETSc.Vec) -> None:
        y.array[:] = self.inverse.solve(x.array_r[:, None])[:, 0]


def _eigensolver(
    stiffness: PETSc.Mat, mass: PETSc.Mat, inverse: Inverse, count: int, prefix: str
) -> SLEPc.EPS:
    """Set up SLEPc for `eigenmodes`, whose arguments these are."""
    eps = SLEPc.EPS().create(stiffness.comm)
    eps.setOptionsPrefix(prefix + "_")
    eps.setOperators(stiffness, mass)
    eps.setProblemType(SLEPc.EPS.ProblemType.GHEP)
    eps.setType(SLEPc.EPS.Type.KRYLOVSCHUR)
    eps.setWhichEigenpairs(SLEPc.EPS.Which.TARGET_MAGNITUDE)
    eps.setTarget(0.0)
    # SLEPc looks for converged modes only when the space is complete; it has 15 vectors more itself
    eps.setDimensions(count, min(max(2 * count, count + SPARE_VECTORS), stiffness.getSize()[0]))
    eps.setTolerances(EIGEN_TOLERANCE, 500)
    st = eps.getST()
    st.setType(SLEPc.ST.Type.SINVERT)
    ksp = st.getKSP()
    ksp.setType(PETSc.KSP.Type.PREONLY)
    pc = ksp.getPC()
    pc.setType(PETSc.PC.Type.PYTHON)
    pc.setPythonContext(_Preconditioner(inverse))
    # The same start on any number of ranks: no random numbers. It has no part in the null space of
    # M, and then no vector has one, so that SLEPc need not remove it by a solve for each mode.
    start, image = stiffness.createVecs()
    first, last = start.getOwnershipRange()
    start.array[:] = 1.0 + 0.5 * np.sin(1.0 + np.arange(first, last, dtype=np.float64))
    mass.mult(start, image)
    start.array[:] = inverse.solve(image.array[:, None])[:, 0]
    eps.setInitialSpace(start)
    eps.setPurify(False)
    eps.setFromOptions()
    start.destroy()
    image.destroy()
    return eps


def eigenmodes(
    stiffness: PETSc.Mat, mass: PETSc.Mat, inverse: Inverse, count: int, prefix: str
) -> tuple[Array, Array]:
    """The lowest modes of K phi = omega^2 M phi by Krylov-Schur on K^-1 M.

    Args:
        stiffness: K.
        mass: M, symmetric and positive semidefinite.
        inverse: applies K^-1; with coordinates held, the inverse of the constrained matrix.
        count: number of modes.
        prefix: prefix of the SLEPc options.

    Returns:
        omega squared (count,), ascending, in rad^2/s^2, and the modes (local rows, count),
        mass-normalised.

    Raises:
        ConvergenceError: fewer pairs converged than were asked for.
        AccuracyError: a residual is above `EIGEN_CHECK`.
    """
    if count == 0:
        return np.zeros(0), np.zeros((stiffness.getLocalSize()[0], 0))
    eps = _eigensolver(stiffness, mass, inverse, count, prefix)
    try:
        eps.solve()
    except PETSc.Error as error:
        raise ConvergenceError(
            f"the modes were not found: SLEPc failed with error code {error.ierr}; the numbers of "
            "the scene may be too large or too small"
        ) from None
    if eps.getConverged() < count:
        raise ConvergenceError(
            f"only {eps.getConverged()} of {counted(count, 'mode')} converged in "
            f"{counted(eps.getIterationNumber(), 'iteration')}"
        )
    squares = np.array([eps.getEigenvalue(k).real for k in range(count)])
    modes = np.empty((stiffness.getLocalSize()[0], count))
    mode, _ = stiffness.createVecs()
    for k in range(count):
        eps.getEigenvector(k, mode)
        modes[:, k] = mode.array
    eps.destroy()
    mode.destroy()
    return checked_modes(mass, inverse, squares, modes)


def hermitian_eigenmodes(mass: PETSc.Mat, inverse: Inverse, count: int) -> tuple[Array, Array]:
    """As `eigenmodes`, of Hermitian matrices on one rank, by Lanczos' method in complex numbers.

    Real and imaginary parts of complex numbers follow each other in the real matrices, in which
    each mode comes twice. So half as many vectors are sought.

    Args:
        mass: M.
        inverse: applies K^-1.
        count: number of modes; of an odd number, the last one comes once.

    Raises:
        ConvergenceError, AccuracyError: as `eigenmodes`.
    """

    def as_complex(times: Callable[[Array], Array]) -> LinearOperator:
        def matvec(z: Any) -> Any:
            return times(np.ascontiguousarray(z).view(float)).view(complex)

        return LinearOperator((size, size), matvec=matvec, dtype=complex)

    def as_real(z: Any) -> Array:
        return np.stack([z.real, z.imag], axis=1).reshape(2 * size, -1)

    size, pairs = mass.getSize()[0] // 2, (count + 1) // 2
    inertia = as_complex(lambda x: multiply(mass, x))
    solve = as_complex(lambda x: inverse.solve(x[:, None])[:, 0])
    start = solve(inertia(1.0 + 0.5 * np.sin(1.0 + np.arange(size, dtype=float)) + 0.0j))
    try:
        squares, z = eigsh(
            solve,  # in place of K, of which only the size counts beside OPinv
            pairs,
            M=inertia,
            sigma=0.0,
            v0=start,
            ncv=min(2 * pairs + SPARE_VECTORS // 2, size),
            tol=EIGEN_TOLERANCE,
            OPinv=solve,
        )
    except ArpackError as error:
        raise ConvergenceError(f"the modes were not found: {error}") from None
    squares, modes = checked_modes(mass, inverse, squares, as_real(z))
    turned = as_real(1j * (modes[::2] + 1j * modes[1::2]))
    both = np.stack([modes, turned], axis=2).reshape(2 * size, -1)
    return np.repeat(squares, 2)[:count], both[:, :count]


def checked_modes(
    mass: PETSc.Mat, inverse: Inverse, squares: Array, modes: Array
) -> tuple[Array, Array]:
    """Modes in ascending order and mass-normalised; arguments and errors as `eigenmodes`."""
    order = np.argsort(squares, kind="stable")
    squares, modes = squares[order], modes[:, order]
    comm = mass.comm.tompi4py()
    inertia = multiply(mass, modes)
    norms = np.sqrt(comm.allreduce(np.sum(modes * inertia, axis=0)))
    modes, inertia = modes / norms, inertia / norms
    residual = (inverse.solve(inertia) - modes / squares) * np.abs(squares).min()
    errors = np.sqrt(comm.allreduce(np.sum(residual * multiply(mass, residual), axis=0)))
    if np.any(errors > EIGEN_CHECK):
        worst = int(np.argmax(errors))
        raise AccuracyError(
            f"mode {worst + 1} has a backward error of {errors[worst]:.1e}, more than "
            f"{EIGEN_CHECK:.0e}"
        )
    return squares, modes


def add_to_diagonal(matrix: PETSc.Mat, values: Array) -> None:
    """Add values (local,) to the diagonal of a matrix. Collective."""
    if not matrix.comm.tompi4py().allreduce(bool(values.any())):
        return
    vector = matrix.createVecLeft()
    vector.array[:] = values
    matrix.setDiagonal(vector, PETSc.InsertMode.ADD_VALUES)
    vector.destroy()


def add_entries(matrix: PETSc.Mat, entries: csr_array) -> None:
    """Add a sparse (local, size) matrix to the entries that a matrix has. Collective."""
    if matrix.comm.tompi4py().allreduce(entries.nnz) == 0:
        return
    starts, columns = (a.astype(PETSc.IntType) for a in (entries.indptr, entries.indices))
    matrix.setValuesCSR(starts, columns, entries.data, PETSc.InsertMode.ADD_VALUES)
    matrix.assemble()
