"""What a run of a scene will cost, and which commands refuse the scene, before anything is solved.

The CPU time follows from measured runs of the demos, see `seconds_of`. Meshes, motions and machines
differ: the estimate holds within a factor of about three.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from fenicsrom.errors import SceneError
from fenicsrom.scene import Scene
from fenicsrom.scene.checks.checks import LEAST_MODES, require_no_sector
from fenicsrom.scene.checks.rotation_checks import require_disk_run
from fenicsrom.scene.keys.times import Duration, FixedStep, StepsPerPeriod
from fenicsrom.words import counted

if TYPE_CHECKING:
    from fenicsrom.fem.solid.solid import Solid

FURTHER = (3, 15)
"""Coordinates besides those of the contact and the modes that nonlinear scenes took.

They were 3 to 8 of beams with one contact point, 3 of a blade with 17 and 15 of a plate with 11.
"""

START = 4.0
"""CPU time to import the program and load its kernels, s."""

OFFLINE = (5.3, 28_224, 0.95)
"""CPU time from the mesh to the reduced model, s, at a number of unknowns, and its power of it."""

FINER = 3.0
"""The same on the finer elements, which judge a mesh that is small enough, relative to the mesh."""

STEP = (4e-6, 2.4e-4 * 1e-6, 0.5e-6)
"""CPU time of a step, s: of itself, by the fourth power of the coordinates, by contact points."""

PERIODS = 1000
"""Periods of steps that a run with periodic loads costs, with its choice of size and its checks."""

TRANSIENT = 10
"""Steps that a step of a run for a given time costs, with its choice of size and its checks."""

FULL = 15e-6, 21
"""CPU time of a step of the full model for each unknown, s, and its periods until it is steady."""

REGIONAL = {
    "contacts": {"preload": "N", "normal_stiffness": "N/m", "tangential_stiffness": "N/m"},
    "attachments": {"stiffness_per_area": "N/m", "damping_per_area": "N s/m"},
}
"""Numbers of regions, with their units at a point."""

USUAL_STEPS = 200
"""Steps of a period with an adaptive step."""


def set_up(scene: Scene) -> Solid:
    """Make the mesh of a scene and find its places, without an equilibrium. On one rank.

    Raises:
        SceneError: a run of the scene would be refused.
    """
    from mpi4py import MPI

    from fenicsrom.fem.body.free_bodies import require_small
    from fenicsrom.fem.mesh.mesh import build_mesh
    from fenicsrom.fem.solid.solid import UNDEFORMED, solid_of
    from fenicsrom.study.stopwatch import Stopwatch

    watch = Stopwatch()
    with watch("mesh"):
        mesh = build_mesh(scene.geometry, MPI.COMM_SELF)
    with watch("supports, loads and contacts"):
        solid = solid_of(scene, mesh, UNDEFORMED, free=True)
    if not scene.static_only:
        require_small(solid)
    return solid


def refusal_of(command: str, scene: Scene) -> str:
    """Why a command would refuse the scene; "" if it would not."""
    try:
        require_usable(command, scene)
    except SceneError as error:
        return str(error)
    return ""


def require_usable(command: str, scene: Scene) -> None:
    """Check that a command can use a scene, before anything is computed.

    Raises:
        SceneError: the command would refuse the scene.
    """
    if command not in ("run", "response", "modes", "campbell", "compare", "sweep"):
        require_no_sector(scene, command)
    check: Callable[[Scene], object] = str
    if command in ("run", "sweep") and scene.cyclic is not None:
        check = require_disk_run
    match command:  # each check is imported when it is needed
        case "response":
            from fenicsrom.assess.curves.response_problem import check_response as check
        case "backbone":
            from fenicsrom.assess.curves.backbone import check_backbone as check
        case "ringdown":
            from fenicsrom.assess.studies.ringdown import check_ringdown as check
        case "statics":
            from fenicsrom.assess.curves.equilibrium_path import varied_loads as check
        case "compare" if scene.cyclic is not None:
            from fenicsrom.assess.studies.compare_disk import scenes_of_disks as check
        case "campbell":
            from fenicsrom.assess.rotation.campbell import speeds_rpm as check
        case "map":
            from fenicsrom.assess.studies.interaction import map_speeds as check
    check(scene)


def forecast(scene: Scene, solid: Solid) -> list[str]:
    """Sentences on the unknowns, the coordinates, the CPU time, and the units of regions."""
    points = solid.points.contact.size
    lines = [f"unknowns: {solid.free}, {counted(points, 'contact point')}"]
    if not scene.static_only and scene.speeds_rpm is None and scene.cyclic is None:
        least, most, parts = coordinates_of(scene, points)
        number = f"{least} to {most}" if most > least else f"{least}"
        lines.append(f"coordinates: about {number}: {parts}")
        seconds = seconds_of(scene, solid.free, points, (least + most) // 2)
        lines.append(
            f"CPU time: about {float(f'{seconds:.1g}'):g} s, within a factor of three; the first "
            "run of all compiles kernels for half a minute"
        )
    if solid.cut is not None and scene.cyclic is not None:
        waves = ", ".join(map(str, scene.cyclic.waves))
        lines += [solid.cut.sentence, f"nodal diameters {waves}"]
    return lines + solid.pairs + region_units(scene, solid)


def coordinates_of(scene: Scene, points: int) -> tuple[int, int, str]:
    """The number of coordinates that a run will probably have, from and to, and its parts."""
    from fenicsrom.reduction.interface import VECTORS

    basis, directions = scene.basis, points * scene.geometry.dimension
    if not scene.contacts:
        masters = 0
    elif isinstance(basis.masters, int):
        masters = min(basis.masters, directions)
    elif basis.masters == "motion":
        masters = min(VECTORS, directions)
    else:
        masters = points if basis.masters == "normal" else directions
    modes = LEAST_MODES if isinstance(basis.modes, str) else basis.modes
    named = f"{modes} modes" + (" or more" if isinstance(basis.modes, str) else "")
    parts = f"{masters} of the contact, {named}"
    if basis.size is not None:
        return basis.size, basis.size, "basis.size"
    if not scene.geometrically_nonlinear or basis.derivatives == "none":
        return masters + modes, masters + modes, parts
    low, high = (masters + modes + more for more in FURTHER)
    return low, high, f"{parts}, and derivatives"


def seconds_of(scene: Scene, unknowns: int, points: int, coordinates: int) -> float:
    """The CPU time of a run with kept kernels, s.

    The stages up to the reduced model cost 5.3, 14 and 52 s with 28,224, 93,600 and 297,702
    unknowns. A step of a model with n coordinates and P points costs 5 µs (6, 1), 12 µs (12, 1), 85
    µs (24, 1), 70 µs (22, 17) and 115 µs (22, 101). Runs of 240, 1,080, 3,672 and 2,592 unknowns
    took 10, 17, 37 and 46 s, with the compilation of kernels in the first three.
    """
    from fenicsrom.fem.solid.finer import LARGEST

    whole, at, power = OFFLINE
    offline = whole * (unknowns / at) ** power * (1.0 + (FINER if unknowns <= LARGEST else 0.0))
    alone, by_fourth, by_point = STEP
    step = alone + by_point * points
    if scene.geometrically_nonlinear:
        step += by_fourth * coordinates**4
    each, periods = FULL
    span, stepping = scene.time.span, scene.time.stepping
    if isinstance(span, Duration):
        length = stepping.step if isinstance(stepping, FixedStep) else span.duration / USUAL_STEPS
        steps = span.duration / length
        full = steps
        steps *= TRANSIENT
    else:
        a_period = USUAL_STEPS
        if isinstance(stepping, StepsPerPeriod):
            a_period = stepping.steps_per_period
        steps, full = PERIODS * a_period, periods * a_period
    motions = steps * step + (full * each * unknowns if scene.reference.full else 0.0)
    return START + offline + motions


def region_units(scene: Scene, solid: Solid) -> list[str]:
    """The numbers of regions, each with the unit that holds."""
    found = []
    for table, keys in REGIONAL.items():
        for k, one in enumerate(getattr(scene, table)):
            if table == "contacts" and one.place.at != "nodes":
                continue
            for key, unit in keys.items():
                if value := getattr(one, key):
                    lengths = solid.mesh.unit_lengths(one.place)
                    number = scene.units.per_region(value, unit, lengths)
                    found.append(f"{table}[{k}].{key} = {number}")
    return found
