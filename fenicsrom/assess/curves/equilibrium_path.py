"""The path of static equilibria of a body as a factor multiplies its static loads.

The full model of the solid is followed (`fem.paths.equilibrium_path`), through limit points, at
which the body under a growing load would snap through.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.assess.errors.comparisons import MeshCheck, of_solid
from fenicsrom.assess.errors.plausibility import slides, strain_warnings, turns
from fenicsrom.errors import AccuracyError, ConvergenceError, ErrorKind, job_error, refuse
from fenicsrom.notes import STABILITY, Note, NoteKind
from fenicsrom.online.contact.state import OPEN, SLIP
from fenicsrom.online.stress.stress import Deformation
from fenicsrom.progress import is_stopped, log, working_time
from fenicsrom.scene import Scene
from fenicsrom.words import brief, counted, enumerated

if TYPE_CHECKING:
    from fenicsrom.fem.paths.equilibrium_path import PathFollower, PathPoint
    from fenicsrom.fem.solid.solid import Solid

SYMMETRIC = 1e-6  # a smaller part of the tangent that is not symmetric is rounding
REPORT_INTERVAL = 2.0  # shortest time between two lines of progress, s
NO_POTENTIAL = (
    "the follower pressures have no potential: the tangent stiffness is not symmetric, and the "
    "negative pivots, which tell stable from unstable equilibria, are those of its symmetric part"
)
HALVED = (
    0.01  # change by half the steps from which the stability of a path with friction is doubted
)


@dataclass(frozen=True, eq=False)
class Equilibrium:
    """One equilibrium of a path.

    Attributes:
        load_factor: factor on the loads of the path.
        probe: (d,) displacement of the probe, m.
        largest: largest component of the displacement of any node, m.
        negative_pivots: number of negative eigenvalues of the tangent stiffness; the equilibrium is
            stable without any. At a special point this may be the number on either side.
        residual: length of Newton's correction with the exact tangent there, relative to the
            displacement and the load.
        deformation: extremes of the deformation at the quadrature points.
        states: (P,) OPEN, SLIP or STICK of the contact points.
        contact: (P, d) their displacements, m.
        dissipated: what friction dissipated on the path up to the last ordinary point, J.
        kind: "" of an ordinary point, else "limit point" or "bifurcation".
    """

    load_factor: float
    probe: Array
    largest: float
    negative_pivots: int
    residual: float
    deformation: Deformation
    states: NDArray[np.int8]
    contact: Array
    dissipated: float = 0.0
    kind: str = ""

    @property
    def closed(self) -> int:
        """Number of closed contact points."""
        return int(np.sum(self.states != OPEN))

    @property
    def slipping(self) -> int:
        """Number of contact points that slip."""
        return int(np.sum(self.states == SLIP))


@brief()
@dataclass(eq=False, repr=False)
class EquilibriumPath:
    """The equilibria of a scene.

    Attributes:
        scene: the scene.
        unknowns: free unknowns of the mesh.
        direction: the probe's component that changes most on the path.
        body: the body.
        points: the equilibria in the order of the path, special points among them.
        shapes: label -> displacement (local,) at each special point and at the last point, m.
        reason: why the path ends: "end of the range", "displacement of the probe", "sliding",
            "number of points", "no convergence" or "interrupted".
        seconds: run time.
        warnings: notes for the user.
        unfinished: the error that ended the computation, or None.
        mesh_check: estimated error of the probe's linear deflection due to the mesh.
        interrupted: whether the run was asked to stop.
        files: the written files, the one to open first at the head.
    """

    scene: Scene
    unknowns: int
    body: Solid | None = None
    points: list[Equilibrium] = field(default_factory=list)
    shapes: dict[str, Array] = field(default_factory=dict)
    reason: str = "interrupted"
    seconds: float = 0.0
    warnings: list[Note] = field(default_factory=list)
    unfinished: AccuracyError | ConvergenceError | None = None
    mesh_check: MeshCheck = field(default_factory=MeshCheck)
    interrupted: bool = False
    files: list[Path] = field(default_factory=list)

    @property
    def direction(self) -> int:
        """The probe's component that changes most on the path."""
        return int(np.argmax(np.ptp([point.probe for point in self.points], axis=0)))

    @property
    def special(self) -> list[Equilibrium]:
        """The limit points and bifurcations, in the order of the path."""
        return [point for point in self.points if point.kind]


def varied_loads(scene: Scene) -> list[int]:
    """The numbers of the static loads that the load factor multiplies.

    Raises:
        SceneError: no static load varies, or the equilibria of the scene are no path of the bare
            body.
    """
    chosen = scene.statics.loads
    listed = range(len(scene.loads)) if chosen is None else chosen
    found = [k for k in listed if scene.loads[k].static]
    if not any(scene.loads[k].size != 0.0 for k in found):
        reason = "a static load of a size other than 0 is needed"
        raise refuse(scene.source, reason, ErrorKind.MISSING, "loads")
    if not scene.is_seen:
        reason = "must be a table where no load and no contact has a place"
        raise refuse(scene.source, reason, ErrorKind.MISSING, "probe")
    if not scene.geometrically_nonlinear:
        reason = "false: must be true, because a linear path is a straight line"
        raise refuse(scene.source, reason, ErrorKind.CONFLICT, "geometrically_nonlinear")
    if scene.contacts and not scene.joined:
        reason = "not allowed without a contact between bodies: the path is that of the body alone"
        raise refuse(scene.source, reason, ErrorKind.CONFLICT, "contacts")
    for k, contact in enumerate(scene.contacts):
        if contact.abradable is not None:
            reason = "not allowed: a layer wears in a motion"
            raise refuse(scene.source, reason, ErrorKind.CONFLICT, f"contacts[{k}].abradable")
    return found


def equilibrium_path(
    scene: Scene,
    comm: Any,
    visit: Callable[[PathPoint], None] = lambda point: None,
) -> EquilibriumPath:
    """Follow the equilibria of a scene as a factor multiplies its static loads.

    Args:
        scene: the scene; its table [statics] gives the range.
        comm: MPI communicator.
        visit: receives each point with its displacement.

    Returns:
        The equilibria. After an interrupt, `interrupted` is set, and the equilibria end there. If
        the path was lost, `unfinished` holds the error.

    Raises:
        SceneError: see `varied_loads`; or the scene does not fit its mesh.
        ConvergenceError: there is no equilibrium under the constant loads.
    """
    from fenicsrom.fem.paths.equilibrium_path import PathFollower

    begin, table = working_time(), scene.statics
    varied = varied_loads(scene)
    body = _body(scene, varied, comm)
    sizes = np.array([load.size if k in varied else 0.0 for k, load in enumerate(scene.loads)])
    found = EquilibriumPath(scene, body.free, body, warnings=list(body.warnings))
    if dropped := sum(not load.static for load in scene.loads):
        text = f"{dropped} of the loads vary in time and do not act on the path"
        found.warnings.append(Note(NoteKind.REMARK, text))
    lowest = -table.last if table.lowest is None else table.lowest
    try:
        constant = body.pressures.static.copy()
        follower = PathFollower(body, sizes, lowest, table.last)
        _follow(follower, body, found, visit)
        if follower.equations.asymmetry > SYMMETRIC:
            note = Note(NoteKind.WARNING, NO_POTENTIAL, quantity=STABILITY)
            if scene.joined:
                body.pressures.static = constant
                note = _friction_note(found, partial(PathFollower, body, sizes, lowest, table.last))
            found.warnings.append(note)
    except Exception as error:
        if comm.size > 1 and not isinstance(error, ConvergenceError):
            raise  # the other ranks would wait for this one
        found.reason = "no convergence"
        found.unfinished = ConvergenceError(f"statics: {job_error(error)}{_where(found)}")
    except KeyboardInterrupt:
        found.interrupted = True
    if not found.interrupted and not scene.joined:
        found.mesh_check = of_solid(
            _without(scene, varied),
            body,
            deflection=lambda solid: solid.factor.solve(solid.load_vectors @ sizes[:, None])[:, 0],
        )
        found.warnings += found.mesh_check.warnings(scene)
        found.unfinished = found.unfinished or found.mesh_check.failure(scene)
    found.warnings += strain_warnings(
        [
            (f"from the load factor {point.load_factor:.6g} of the path on", point.deformation)
            for point in found.points
        ]
    )
    moved = np.array([point.contact for point in found.points])
    closed = np.array([point.states != OPEN for point in found.points])
    if found.points:
        found.warnings += slides(moved, closed, body.points, scene)
        found.warnings += turns(body, scene, np.column_stack([*found.shapes.values()]))
    found.seconds = working_time() - begin
    return found


def _friction_note(found: EquilibriumPath, again: Callable[[], PathFollower]) -> Note:
    """Judge the stability on a path on which points slip, by the pivots and by half the steps.

    Args:
        found: the path.
        again: begins the path again.
    """
    text = "contact points slip: the negative pivots, which tell stable from unstable equilibria, "
    text += "are those with the friction forces held constant"
    unstable = any(point.negative_pivots for point in found.points)
    if unstable or found.reason != "end of the range":
        return Note(NoteKind.WARNING, text, quantity=STABILITY)
    log.info("path with half the steps ..")
    finer, last, body = again(), found.points[-1], found.body
    finer.longest *= 0.5
    assert body is not None and finer.equations.contact is not None
    try:
        for point in finer.points():
            unstable = unstable or point.negative > 0
            if body.comm.bcast(is_stopped()):
                raise KeyboardInterrupt
    except ConvergenceError as error:
        text = f"{text}; the path with half the steps is lost: {error}"
        return Note(NoteKind.WARNING, text, quantity=STABILITY)
    probe = body.comm.allreduce(body.probe_rows @ point.displacement)
    moved = float(np.linalg.norm(probe - last.probe) / np.linalg.norm(last.probe))
    spent = finer.equations.contact.dissipated
    rubbed = abs(spent / last.dissipated - 1.0) if last.dissipated > 0.0 else 0.0
    text += (
        f"; there are none, and half the steps change the last displacement by {100.0 * moved:.2g} "
        f"% and the friction by {100.0 * rubbed:.2g} %"
    )
    if max(moved, rubbed) <= HALVED and not unstable:
        return Note(NoteKind.REMARK, text, quantity=STABILITY)
    text += f" (at most {100.0 * HALVED:g} % casts no doubt)"
    return Note(NoteKind.WARNING, text, quantity=STABILITY)


def _body(scene: Scene, varied: list[int], comm: Any) -> Solid:
    """The solid in its equilibrium under the constant loads."""
    from fenicsrom.fem.mesh.mesh import build_mesh
    from fenicsrom.fem.solid.solid import solid_of

    log.info("mesh ..")
    mesh = build_mesh(scene.geometry, comm)
    log.info("solid ..")
    try:
        return solid_of(_without(scene, varied), mesh)
    except ConvergenceError as error:
        loads = enumerated([f"loads[{k}]" for k in varied])
        reason = f"statics: at the load factor 0, without {loads}: {error}; statics.loads chooses "
        raise ConvergenceError(f"{reason}the loads that the factor multiplies") from error


def _without(scene: Scene, varied: list[int]) -> Scene:
    """The scene with the constant loads only."""
    loads = [
        load.changed(**{load.kind: 0.0}) if k in varied else load
        for k, load in enumerate(scene.loads)
    ]
    return replace(scene, loads=tuple(loads))


def _follow(
    follower: PathFollower,
    body: Solid,
    found: EquilibriumPath,
    visit: Callable[[PathPoint], None],
) -> None:
    """Collect the points of the path.

    Raises:
        ConvergenceError: the path was lost.
        KeyboardInterrupt: the work was asked to stop.
    """
    from fenicsrom.fem.body.stress_points import body_deformation

    table, last = found.scene.statics, clock.perf_counter()
    log.info("path ..")
    for point in follower.points():
        visit(point)
        probe = body.comm.allreduce(body.probe_rows @ point.displacement)
        size = float(body.largest(point.displacement[:, None])[0])
        contact = follower.equations.contact
        found.points.append(
            Equilibrium(
                load_factor=point.load_factor,
                probe=np.asarray(probe),
                largest=size,
                negative_pivots=point.negative,
                residual=point.residual,
                deformation=body_deformation(body, found.scene, point.displacement),
                states=point.states,
                contact=body.contact_displacement(point.displacement).reshape(-1, body.dimension),
                dissipated=contact.dissipated if contact else 0.0,
                kind=point.kind,
            )
        )
        found.shapes.pop("end", None)
        label = f"{point.kind} {len(found.shapes) + 1}" if point.kind else "end"
        found.shapes[label] = point.displacement
        if point.kind:
            log.info(f"  {point.kind} at the load factor {point.load_factor:.6g}")
        elif clock.perf_counter() - last > REPORT_INTERVAL:
            last = clock.perf_counter()
            log.info(
                f"  {counted(len(found.points), 'point')}, load factor {point.load_factor:.4g}"
            )
        if body.comm.bcast(is_stopped()):
            raise KeyboardInterrupt
        if table.displacement is not None and np.linalg.norm(probe) >= table.displacement:
            found.reason = "displacement of the probe"
            return
        if len(found.points) >= table.points and not follower.reason:
            found.reason = "number of points"
            return
    found.reason = follower.reason


def _where(found: EquilibriumPath) -> str:
    """Where the path ends, in words."""
    if not found.points:
        return ""
    end = found.points[-1]
    probe = ", ".join(f"{1e3 * u:.5g}" for u in end.probe)
    return (
        f", from the load factor {end.load_factor:.6g} on, where the probe is displaced by "
        f"({probe}) mm"
    )
