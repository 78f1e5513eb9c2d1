"""How far the program can be pushed: a matrix of extreme scenes, and a verdict on each run.

Each axis below leads from the ordinary to the absurd, alone and then in the worst pairs. A run is
made as a user would make it, and again with half the step (an eighth of the tolerance) and, where
the basis is in question, with a richer basis. Its verdict is one of

    converged       settled, and off from the refined run by no more than its own error estimate not
    steady      it never repeats (or not yet), and says so; bounded, its energy accounted for
    refused         no result: a SceneError, ConvergenceError or AccuracyError says why in a
    sentence silently wrong  off by more than its own estimate, energy from nowhere, unbounded, or
    any other exception

The own estimates are `fenicsrom.assess.estimates.step_errors` and `fenicsrom.assess.estimates.basis_error`, which
`fenicsrom run` prints and checks too. How far off each scheme is by its steps is found on a few of
the cases by `fenicsrom.schemes`.
"""

from __future__ import annotations

import multiprocessing
import tempfile
import textwrap
import time as clock
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fenicsrom.assess import schemes
from fenicsrom.assess.estimates import refined, step_errors
from fenicsrom.assess.verdicts import (
    BASIS_ERROR,
    check_basis_error,
    check_energy,
    check_time_error,
)
from fenicsrom.errors import AccuracyError, ConvergenceError, SceneError
from fenicsrom.files import atomic_write
from fenicsrom.online.archive import provenance
from fenicsrom.online.measures import (
    amplitude,
    difference,
    has_settled,
    is_unsteady,
    peak_normal_force,
)
from fenicsrom.online.motion import Motion
from fenicsrom.online.simulate import simulate
from fenicsrom.post.html_page import html_report
from fenicsrom.post.style import new_figure, styled
from fenicsrom.post.writers import write_rows, write_summary
from fenicsrom.scene import Scene, override_table, parse_scene, read_scene

if TYPE_CHECKING:
    from fenicsrom.study import Study

CONVERGED, UNSTEADY, REFUSED, WRONG = "converged", "not steady", "refused", "silently wrong"
VERDICTS = (CONVERGED, UNSTEADY, REFUSED, WRONG)

FLOOR = 1e-3  # relative differences below this count as none, whatever the estimate
SAME = 1e-6  # relative difference allowed between runs in different units
GAIN = 1e-12  # of the energies: what friction may give in a step, by rounding
BAND = (
    0.5  # relative difference allowed between the root mean squares of motions that are not steady
)

WORKERS = 2


@dataclass(frozen=True)
class Case:
    """A run of the matrix.

    Attributes:
        axis: what is driven to its extreme.
        value: how far, in a few words.
        overrides: of the scene.
        model: "reduced", "full" or "beam".
        richer: overrides for a richer basis to compare with.
        scale: length in m of the unit of the scene; not 1: the run must agree with that of the
            plain scene.
    """

    axis: str
    value: str
    overrides: tuple[str, ...]
    model: str = "reduced"
    richer: tuple[str, ...] = ()
    scale: float = 1.0


@dataclass(frozen=True)
class Finding:
    """What a case came to.

    Attributes:
        case: the case.
        verdict: one of `VERDICTS`.
        why: a sentence; of the error, if it was refused.
        amplitude: of the contact point or probe, m.
        estimate: the run's own estimate of its relative error by the time step.
        basis_estimate: the same by the basis.
        error: relative difference from the refined run.
        basis_error: relative difference from the richer basis.
        force_error: relative difference of the peak normal force from the refined run's.
        force_estimate: the run's own estimate of that, infinite where the step does not resolve the
        contact.
        imbalance: of the energy ledger, relative.
        steady: whether the motion repeats to the scene's tolerance.
        periods: number of periods run.
        buckled: number of directions in which the straight equilibrium is unstable.
        seconds: all runs of the case.
    """

    case: Case
    verdict: str
    why: str = ""
    amplitude: float | None = None
    estimate: float | None = None
    basis_estimate: float | None = None
    error: float | None = None
    basis_error: float | None = None
    force_error: float | None = None
    imbalance: float | None = None
    steady: bool | None = None
    periods: int | None = None
    seconds: float = 0.0
    force_estimate: float | None = None
    buckled: int = 0


# ---------------------------------------------------------------------- the matrix

LOAD, CONTACT = "loads.0.", "contacts.0."
KN, KT = CONTACT + "normal_stiffness", CONTACT + "tangential_stiffness"
RICH = ("basis.modes=5", "basis.derivatives='all'")
CRITICAL = (
    LOAD + "force=500",
    CONTACT + "preload=20",
    CONTACT + "friction=0.2",
    LOAD + "frequency=3.25",
)
WALL = (
    CONTACT + "normal=[0.0, 1.0]",
    CONTACT + "preload=0",
)  # across the swing: the tip hits it at speed
PAPER = {
    "slip and lift-off": (),
    "stick and slip": (LOAD + "frequency=8.1", CONTACT + "preload=250"),
    "high load": (LOAD + "force=333.3", CONTACT + "preload=200"),
    "500 N, 20 N": CRITICAL,
}

STUDIED = {
    **PAPER,
    "impact on 1e5 N/m": (*WALL, f"{CONTACT}gap=0.1", f"{KN}=1e5"),
}  # by every scheme

BUCKLING = 2745.7  # N, Euler's load of the beam, clamped and free
CASING = "{{kind='cylinder', point=[{centre!r}, 0.0], inside={inside}}}"


def round_surface(radius: float, inside: bool = True) -> tuple[str, ...]:
    """The wall before the tip bent to a casing of this radius about the root's side, or to a shaft
    beyond it.
    """
    table = {
        "group": "'tip'",
        "at": "'centre'",
        "preload": "40.0",
        "friction": "0.5",
        "normal_stiffness": "1e4",
        "tangential_stiffness": "1e4",
        "surface": CASING.format(
            centre=2.54 - radius if inside else 2.54 + radius, inside=str(inside).lower()
        ),
    }
    return ("contacts=[{" + ", ".join(f"{key}={value}" for key, value in table.items()) + "}]",)


# axis -> value -> overrides
AXES: dict[str, dict[str, tuple[str, ...]]] = {
    "the scene": PAPER,
    "contact stiffness": {
        f"{k:g} N/m": (f"{KN}={k!r}", f"{KT}={k!r}") for k in (1e3, 1e5, 1e6, 1e8, 1e10, 1e12)
    },
    "k_t and k_n apart": {
        f"{n:g}, {t:g} N/m": (f"{KN}={n!r}", f"{KT}={t!r}")
        for n, t in ((1e3, 1e8), (1e8, 1e3), (1e12, 1e4), (1e4, 1e12))
    },
    "friction": {f"{mu:g}": (f"{CONTACT}friction={mu!r}",) for mu in (0.0, 0.01, 1.0, 3.0, 10.0)},
    "preload": {
        f"{n:g} N": (f"{CONTACT}preload={n!r}",) for n in (0.0, 10.0, 250.0, 1e3, 2e3, 2.6e3)
    },
    "preload beyond buckling": {
        name: (f"{CONTACT}preload={n!r}", f"{CONTACT}friction={mu!r}")
        for name, n, mu in (
            ("2700 N, no friction", 2700.0, 0.0),
            ("3500 N", 3500.0, 0.5),
            ("3500 N, no friction", 3500.0, 0.0),
            ("5400 N", 5400.0, 0.5),
            ("5400 N, no friction", 5400.0, 0.0),
        )
    },
    "preload through buckling": {
        f"{x:g} times the buckling load": (
            f"{CONTACT}preload={x * BUCKLING!r}",
            f"{CONTACT}friction=0.1",
        )
        for x in (0.5, 0.9, 0.99, 1.01, 1.1, 2.0)
    },
    "load": {
        f"{x:g} times": (f"{LOAD}force={111.29 * x!r}",)
        for x in (1e-6, 1e-3, 0.1, 2.0, 5.0, 10.0, 30.0)
    },
    "damping": {
        f"{a:g} 1/s": (f"material.mass_damping={a!r}",) for a in (0.0, 0.1, 1.0, 41.2, 200.0, 1e4)
    },
    "steps per period": {
        str(n): (f"time.steps_per_period={n}",) for n in (10, 20, 50, 100, 500, 2000)
    },
    "tolerance": {f"{t:g}": (f"time.tolerance={t!r}",) for t in (1e-1, 1e-2, 1e-3, 1e-5)},
    "Poisson's ratio": {
        f"{nu:g}, plane {plane}": (f"material.poisson={nu!r}", f"geometry.plane='{plane}'")
        for nu, plane in ((0.0, "stress"), (0.499, "stress"), (0.45, "strain"), (0.499, "strain"))
    },
    "Young's modulus": {f"{e:g} Pa": (f"material.young={e!r}",) for e in (1e3, 1e7, 1e9, 1e13)},
    "contact direction": {
        "at the clamp": (f"{CONTACT}group='root'",),
        "aslant": (f"{CONTACT}normal=[1.0, 1.0]",),
        "across": (f"{CONTACT}normal=[0.0, 1.0]",),
    },
    "modes in the Rubin basis": {str(n): (f"basis.modes={n}",) for n in (1, 2, 5, 10, 20, 40)},
    "dependent derivatives": {
        "3 modes, all": ("basis.derivatives='all'",),
        "5 modes, all": RICH,
        "4 modes, threshold 0": ("basis.modes=4", "basis.threshold=0"),
        "Craig–Bampton, 4 modes, all": (
            "basis.method='craig-bampton'",
            "basis.modes=4",
            "basis.derivatives='all'",
        ),
    },
    "too few derivatives": {
        "none": ("basis.derivatives='none'",),
        "1V1V of one mode": ("basis.modes=1", "basis.derivatives=['1V1V']"),
    },
    "impact": {
        f"gap {1e3 * gap:g} mm, {k:g} N/m": (*WALL, f"{CONTACT}gap={gap!r}", f"{KN}={k!r}")
        for gap, k in ((0.02, 1e4), (0.02, 1e6), (0.02, 1e8), (0.1, 1e5), (0.19, 1e10))
    },
    "curved surface": {
        "casing of 2.54 m": round_surface(2.54),
        "casing of 10 m": round_surface(10.0),
        "casing of 0.6 m": round_surface(0.6),
        "shaft of 1 m": round_surface(1.0, inside=False),
        "casing of 2.54 m, 1e8 N/m": (*round_surface(2.54), f"{KN}=1e8"),
    },
    "speed": {
        f"{rpm:g} rpm": (
            f"rotation={{speed_rpm={rpm!r}, coriolis={str(rpm > 100.0).lower()}}}",
            "reference={}",
        )
        for rpm in (1.0, 60.0, 600.0)
    },
    "a thousand periods": {
        "steady": ("time.periods=1000", "time.steady_tolerance=0"),
        "500 N, 20 N": (*CRITICAL, "time.periods=1000", "time.steady_tolerance=0"),
    },
    "scheme": {
        f"{scheme}, {n} steps, {name}": (
            *PAPER[name],
            f"time.scheme='{scheme}'",
            f"time.steps_per_period={n}",
        )
        for scheme, n, name in (
            ("average-acceleration", 20, "slip and lift-off"),
            ("average-acceleration", 100, "slip and lift-off"),
            ("average-acceleration", 200, "500 N, 20 N"),
            ("average-acceleration", 100, "high load"),
            ("generalised-alpha", 20, "slip and lift-off"),
            ("generalised-alpha", 100, "500 N, 20 N"),
            ("discrete-gradient", 50, "stick and slip"),
            ("discrete-gradient", 50, "high load"),
            ("discrete-gradient", 50, "500 N, 20 N"),
        )
    },
    "worst pairs": {
        "10 steps, 1e10 N/m": ("time.steps_per_period=10", f"{KN}=1e10"),
        "10 steps, high load": (*PAPER["high load"], "time.steps_per_period=10"),
        "friction 10, 1e10 N/m": (f"{CONTACT}friction=10", f"{KN}=1e10", f"{KT}=1e10"),
        "10 times the load, 1e10 N/m": (f"{LOAD}force=1112.9", f"{KN}=1e10"),
        "undamped, 1e8 N/m": ("material.mass_damping=0", f"{KN}=1e8"),
        "undamped, 10 times the load": ("material.mass_damping=0", f"{LOAD}force=1112.9"),
        "5.4 kN, 10 times the load": (f"{CONTACT}preload=5400", f"{LOAD}force=1112.9"),
        "5.4 kN, friction 10, 1e8 N/m": (
            f"{CONTACT}preload=5400",
            f"{CONTACT}friction=10",
            f"{KT}=1e8",
        ),
        "40 modes, 1e10 N/m": ("basis.modes=40", f"{KN}=1e10"),
        "impact, 1e10 N/m, 50 steps": (
            *WALL,
            f"{CONTACT}gap=0.02",
            f"{KN}=1e10",
            "time.steps_per_period=50",
        ),
        "plane strain 0.499, 10 times the load": (
            "material.poisson=0.499",
            "geometry.plane='strain'",
            f"{LOAD}force=1112.9",
        ),
        "1e-6 times the load, 1e12 N/m": (
            f"{LOAD}force=1.1129e-4",
            f"{KN}=1e12",
            f"{CONTACT}preload=4e-5",
        ),
    },
}

RICHER_AXES = {
    "load": ("2 times", "5 times", "10 times", "30 times"),
    "preload beyond buckling": ("2700 N, no friction", "5400 N"),
    "too few derivatives": ("none", "1V1V of one mode"),
    "modes in the Rubin basis": ("1", "2", "10", "40"),
    "impact": ("gap 20 mm, 1e+06 N/m",),
    "the scene": ("high load", "500 N, 20 N"),
    "Young's modulus": ("1000 Pa", "1e+07 Pa"),
    "preload through buckling": ("1.01 times the buckling load", "2 times the buckling load"),
}

# axis -> value: runs that the full model and the beam make too
OTHER_MODELS: dict[str, tuple[str, ...]] = {
    "the scene": tuple(PAPER),
    "contact stiffness": ("1e+08 N/m", "1e+12 N/m"),
    "friction": ("10",),
    "preload beyond buckling": ("3500 N, no friction",),
    "load": ("1e-06 times", "5 times"),
    "steps per period": ("20",),
    "worst pairs": ("friction 10, 1e10 N/m",),
}


def slender(ratio: float) -> tuple[str, ...]:
    """The beam with another L/h, shaken at the same place of its spectrum, as hard for its
    stiffness.
    """
    s = 100.0 / ratio
    bending = s**3  # of the stiffness in bending, the width as it was
    values = {
        "geometry.parameters.height": 0.0254 * s,
        "reference.beam_section.height": 0.0254 * s,
        LOAD + "force": 111.29 * bending,
        LOAD + "frequency": 3.2 * s,
        CONTACT + "preload": 40.0 * bending,
        KN: 1e4 * bending,
        KT: 1e4 * bending,
        "material.mass_damping": 5.0 * s,
    }
    return overrides(values)


def in_units(length: float, mass: float, time: float) -> tuple[str, ...]:
    """The beam of the scene in units of these many m, kg and s."""
    force = mass * length / time**2
    stress = force / length**2
    values = {
        "geometry.parameters.length": 2.54 / length,
        "geometry.parameters.height": 0.0254 / length,
        "geometry.thickness": 0.0254 / length,
        "reference.beam_section.length": 2.54 / length,
        "reference.beam_section.height": 0.0254 / length,
        "reference.beam_section.width": 0.0254 / length,
        "material.young": 207e9 / stress,
        "material.density": 7801.0 * length**3 / mass,
        "material.mass_damping": 5.0 * time,
        LOAD + "force": 111.29 / force,
        LOAD + "frequency": 3.2 * time,
        CONTACT + "preload": 40.0 / force,
        KN: 1e4 * length / force,
        KT: 1e4 * length / force,
    }
    return overrides(values)


def solid_beam(width: float) -> tuple[str, ...]:
    """The same beam in three dimensions, of this width: at that of its height every frequency of
    bending is double.
    """
    return (
        f"geometry={{mesh='beam3d.geo', dimension=3, parameters={{width={width!r}}}}}",
        LOAD + "direction=[0.0, 1.0, 0.0]",
        CONTACT + "normal=[1.0, 0.0, 0.0]",
        "basis.modes=4",
    )


def overrides(values: Mapping[str, float]) -> tuple[str, ...]:
    """Values by key as overrides of a scene."""
    return tuple(f"{key}={value!r}" for key, value in values.items())


UNITS = {
    "mm, t, s": (1e-3, 1e3, 1.0),
    "cm, g, ms": (1e-2, 1e-3, 1e-3),
    "km, Gg, h": (1e3, 1e6, 3600.0),
}
WIDTHS = {
    "square": 0.0254,
    "one part in 1e8": 0.0254 * (1.0 + 1e-8),
    "one part in 1e4": 0.0254 * (1.0 + 1e-4),
}
SHIFTS = (0.2, 0.45, 0.6)  # of the length of a cell: at a half, its corners meet


def cases(folder: Path) -> Iterator[Case]:
    """The whole matrix; `folder` takes the distorted meshes."""
    for axis, values in AXES.items():
        for value, changes in values.items():
            yield Case(
                axis, value, changes, richer=RICH if value in RICHER_AXES.get(axis, ()) else ()
            )
    for ratio in (5, 20, 500, 2000):
        yield Case("slenderness", f"L/h = {ratio}", slender(ratio))
    for name, (length, mass, time) in UNITS.items():
        yield Case("units", name, in_units(length, mass, time), scale=length)
    for name, width in WIDTHS.items():
        yield Case("nearly coincident modes", name, solid_beam(width))
    for shift in SHIFTS:
        path = zigzag_mesh(folder / f"zigzag_{shift:g}.msh", shift)
        geometry = f"geometry={{mesh={str(path)!r}, dimension=2, thickness=0.0254}}"
        yield Case("distorted mesh", f"zigzag of {shift:g} cells", (geometry,))
    for axis, chosen in OTHER_MODELS.items():
        for value in chosen:
            for model in ("full", "beam"):
                yield Case(axis, value, AXES[axis][value], model)


def zigzag_mesh(
    path: Path, shift: float, along: int = 20, length: float = 2.54, height: float = 0.0254
) -> Path:
    """Write a mesh of the beam, one cell high, its upper and lower nodes moved to and fro by a
    fraction of a cell.
    """
    x = np.linspace(0.0, length, along + 1)
    sway = shift * length / along * (-1.0) ** np.arange(along + 1)
    load = round(0.7 * along)
    sway[[0, load, along]] = 0.0
    nodes = [
        (x[i] + sign * sway[i], 0.5 * sign * height) for i in range(along + 1) for sign in (-1, 1)
    ]
    lines = ["$MeshFormat", "2.2 0 8", "$EndMeshFormat", "$PhysicalNames", "4"]
    lines += [
        '1 1 "root"',
        '1 2 "load"',
        '1 3 "tip"',
        '2 4 "body"',
        "$EndPhysicalNames",
        "$Nodes",
        str(len(nodes)),
    ]
    lines += [
        f"{k + 1} {a!r} {b!r} 0" for k, (a, b) in enumerate((float(p), float(q)) for p, q in nodes)
    ]
    elements = [
        f"1 2 {tag} {tag} {2 * i + 1} {2 * i + 2}" for tag, i in ((1, 0), (2, load), (3, along))
    ]
    elements += [f"3 2 4 4 {2 * i + 1} {2 * i + 3} {2 * i + 4} {2 * i + 2}" for i in range(along)]
    lines += [
        "$EndNodes",
        "$Elements",
        str(len(elements)),
        *(f"{k + 1} {e}" for k, e in enumerate(elements)),
        "$EndElements",
    ]
    path.write_text("\n".join(lines) + "\n", encoding="ascii")
    return path


# ---------------------------------------------------------------------- a run and its verdict


def scene_of(table: Mapping[str, Any], source: str, folder: Path, changes: Iterable[str]) -> Scene:
    """The scene under overrides; a tolerance takes the place of a number of steps, and the other
    way round.
    """
    plain = dict(table)
    plain["reference"] = {**plain.get("reference", {}), "full": False}
    named = {change.partition("=")[0] for change in changes}
    time = dict(plain.get("time", {}))
    for given, other in (
        ("time.tolerance", "steps_per_period"),
        ("time.steps_per_period", "tolerance"),
    ):
        if given in named:
            time.pop(other, None)
    plain["time"] = time
    return parse_scene(override_table(plain, list(changes), source), source, folder)


def build(scene: Scene, model: str) -> tuple[Any, Study | None]:
    """The model of a scene, with the basis the scene asks for, and how the reduced one was made.

    Raises:
        SceneError, ConvergenceError, AccuracyError: as in `fenicsrom.study.run`.
    """
    from mpi4py import MPI

    from fenicsrom import study
    from fenicsrom.fem import full
    from fenicsrom.reduction import beam

    if model == "beam":
        return beam.beam_model(scene), None
    whole = model == "full"
    found = study.offline(
        scene, MPI.COMM_SELF, study.Stopwatch(lambda line: None), modes_only=whole
    )
    return (full.full_model(found.solid), None) if whole else (found.model, found)


def own_basis_error(study: Study, scene: Scene, motion: Motion) -> float | None:
    """What the program itself estimates of the error by the basis; None if there is none to compare
    with.

    Raises:
        AccuracyError: it is too large.
    """
    from fenicsrom.assess.estimates import basis_error, complete
    from fenicsrom.reduction.stages import reduce

    richer = complete(study, motion.buckled > 0)
    if richer is None:
        return None
    estimate = basis_error(reduce(study.solid, scene.basis, richer), scene, motion)
    check_basis_error(scene, estimate)
    return estimate


def unbounded(motion: Motion, scheme: str = "discrete-gradient") -> str:
    """What is not bounded or comes from nowhere; empty if nothing does."""
    arrays = (motion.displacement, motion.kinetic, motion.elastic, motion.force)
    if not all(np.all(np.isfinite(array)) for array in arrays):
        return "a result is not a finite number"
    energy = motion.kinetic + motion.elastic + motion.contact_energy
    created = (
        energy - energy[0] + motion.damping_dissipation + motion.friction_dissipation - motion.work
    )
    scale = float(np.max(motion.kinetic + np.abs(motion.elastic)))
    if float(np.max(created)) > 1e-2 * scale:
        return f"energy created: {float(np.max(created)) / scale:.1e} of the largest"
    gain = -float(np.diff(motion.friction_dissipation).min(initial=0.0))
    if scheme == "discrete-gradient" and gain > GAIN * (scale + motion.friction_dissipation[-1]):
        return f"friction gave {gain:.1e} J in a step"
    return ""


def examine(case: Case, table: Mapping[str, Any], source: str, folder: Path) -> Finding:
    """Run a case and its refined runs, and judge it."""
    begin = clock.perf_counter()
    numbers: dict[str, Any] = {}
    try:
        verdict, why = _examine(case, table, source, folder, numbers)
    except (SceneError, ConvergenceError, AccuracyError) as error:
        verdict, why = REFUSED, f"{type(error).__name__}: {error}"
    except Exception as error:
        verdict, why = WRONG, f"{type(error).__name__}: {error}".splitlines()[0]
    return Finding(case, verdict, why, **numbers, seconds=clock.perf_counter() - begin)


def _examine(
    case: Case, table: Mapping[str, Any], source: str, folder: Path, numbers: dict[str, Any]
) -> tuple[str, str]:
    scene = scene_of(table, source, folder, case.overrides)
    model, study = build(scene, case.model)
    motion = simulate(model, scene)
    numbers |= {
        "amplitude": float(np.linalg.norm(amplitude(motion))) * case.scale,
        "imbalance": motion.relative_imbalance,
        "steady": motion.steady,
        "periods": motion.periods,
        "buckled": motion.buckled,
    }
    check_energy(motion)
    if wrong := unbounded(motion, scene.time.scheme):
        return WRONG, wrong
    numbers["estimate"], numbers["force_estimate"] = estimate, force_estimate = step_errors(
        model, scene, motion
    )
    check_time_error(scene, estimate, is_unsteady(motion))
    if has_settled(motion):
        numbers["basis_estimate"] = own_basis_error(study, scene, motion) if study else None
    fine = simulate(model, refined(scene))
    numbers["error"] = error = difference(motion, fine)
    numbers["force_error"] = (
        abs(peak_normal_force(motion) / peak_normal_force(fine) - 1.0)
        if peak_normal_force(fine)
        else None
    )
    if case.scale != 1.0:
        plain = scene_of(table, source, folder, ())
        other = simulate(build(plain, case.model)[0], plain)
        apart = abs(numbers["amplitude"] / float(np.linalg.norm(amplitude(other))) - 1.0)
        if apart > SAME:
            return WRONG, f"in SI units the amplitude is another, by {apart:.1e}"
    if case.richer:
        rich = scene_of(table, source, folder, (*case.overrides, *case.richer))
        numbers["basis_error"] = difference(motion, simulate(build(rich, case.model)[0], rich))
    if not has_settled(motion):
        if error > max(BAND, estimate):
            return WRONG, f"with half the step the motion is {error:.0%} larger or smaller"
        return UNSTEADY, f"it does not repeat after {motion.periods} periods"
    if motion.steady and not has_settled(fine):
        return WRONG, "steady, but with half the step it does not settle"
    if error > max(FLOOR, estimate):
        return WRONG, f"off by {error:.1e} from half the step, its own estimate is {estimate:.1e}"
    if not has_settled(fine):
        return (
            UNSTEADY,
            "its amplitudes have settled, the motion has not; with half the step not they either",
        )
    if numbers.get("basis_error", 0.0) > BASIS_ERROR:
        return WRONG, f"off by {numbers['basis_error']:.1e} from a richer basis"
    remarks = [
        ("it starts buckled by the preload", motion.buckled > 0),
        (
            "small waves ring on: the amplitudes have settled, the motion has not quite",
            not motion.steady,
        ),
        (
            "the step does not resolve the contact: its peak force is unknown",
            not np.isfinite(force_estimate),
        ),
    ]
    return CONVERGED, "; ".join(remark for remark, holds in remarks if holds)


# ---------------------------------------------------------------------- the matrix, run


@dataclass(eq=False)
class Matrix:
    """All findings of a scene, and what its schemes of time integration come to."""

    scene: Scene
    findings: list[Finding]
    seconds: float
    by_scheme: Sequence[schemes.Series] = ()

    def count(self, verdict: str) -> int:
        """Number of runs with a verdict."""
        return sum(finding.verdict == verdict for finding in self.findings)


def stability(
    path: Path, changes: Sequence[str], say: Callable[[str], None], workers: int = WORKERS
) -> Matrix:
    """Run the matrix of extremes of a scene.

    Args:
        path: the scene file.
        changes: overrides for every run.
        say: is told what happens, a line at a time.
        workers: processes to share the runs.

    Raises:
        SceneError: the scene itself is wrong.
    """
    table, scene = load(path, changes)
    begin = clock.perf_counter()
    with tempfile.TemporaryDirectory(prefix="fenicsrom_") as folder:
        wanted = list(cases(Path(folder)))
        findings = run_all(wanted, table, scene.source, path.parent, say, workers)
    seconds = clock.perf_counter() - begin
    return Matrix(
        scene,
        findings,
        seconds,
        run_schemes(STUDIED, table, scene.source, path.parent, say, workers),
    )


def load(path: Path, changes: Sequence[str] = ()) -> tuple[dict[str, Any], Scene]:
    """The table of a scene file under overrides, and the scene.

    Raises:
        SceneError: it is wrong.
    """
    scene = read_scene(path, changes)
    table = tomllib.loads(path.read_text(encoding="utf-8-sig"))
    return override_table(table, changes, str(path)), scene


def run_all(
    wanted: Sequence[Case],
    table: Mapping[str, Any],
    source: str,
    folder: Path,
    say: Callable[[str], None],
    workers: int,
) -> list[Finding]:
    """Examine cases in so many processes, and say how each went; the findings are in the order of
    the cases.
    """
    jobs = [(k, case, table, source, folder) for k, case in enumerate(wanted)]
    found: dict[int, Finding] = {}

    def note(k: int, finding: Finding) -> None:
        found[k] = finding
        case = finding.case
        say(
            f"{len(found)}/{len(wanted)} {case.axis}, {case.value} ({case.model}): {finding.verdict}"
            + (f": {finding.why}" if finding.why else "")
        )

    for k, finding in _shared(_job, jobs, workers):
        note(k, finding)
    return [found[k] for k in range(len(wanted))]


def _job(job: tuple[int, Case, Mapping[str, Any], str, Path]) -> tuple[int, Finding]:
    k, case, table, source, folder = job
    return k, examine(case, table, source, folder)


def run_schemes(
    wanted: Mapping[str, Sequence[str]],
    table: Mapping[str, Any],
    source: str,
    folder: Path,
    say: Callable[[str], None],
    workers: int,
) -> list[schemes.Series]:
    """Run the reduced model of each case, overrides by name, by every scheme; the series are in the
    order of the cases.
    """
    jobs = [(name, changes, table, source, folder) for name, changes in wanted.items()]
    found: dict[str, schemes.Series] = {}
    for made in _shared(_series, jobs, workers):
        found[made.name] = made
        say(
            f"schemes {len(found)}/{len(jobs)} {made.name}: "
            + (made.failure or f"{len(made.runs)} runs")
        )
    return [found[name] for name in wanted]


def _series(job: tuple[str, Sequence[str], Mapping[str, Any], str, Path]) -> schemes.Series:
    name, changes, table, source, folder = job
    try:
        scene = scene_of(table, source, folder, changes)
        return schemes.series(name, build(scene, "reduced")[0], scene)
    except (SceneError, ConvergenceError, AccuracyError) as error:
        return schemes.Series(name, failure=str(error))


def _shared(work: Callable[[Any], Any], jobs: Sequence[Any], workers: int) -> Iterator[Any]:
    """What the jobs come to, done in so many processes, as they are done."""
    if workers == 1:
        yield from map(work, jobs)
        return
    with multiprocessing.get_context("spawn").Pool(workers) as pool:
        yield from pool.imap_unordered(work, jobs, chunksize=1)


# ---------------------------------------------------------------------- the files

COLOURS = {CONVERGED: "#B7E1CD", UNSTEADY: "#CFE2F3", REFUSED: "#FCE8B2", WRONG: "#E06666"}
HEAD = [
    "verdict",
    "model",
    "axis",
    "value",
    "amplitude mm",
    "estimate",
    "error",
    "basis",
    "peak N",
    "ledger",
    "periods",
    "why",
]


def row(finding: Finding) -> dict[str, Any]:
    """A finding as a flat row: the columns of `stability.csv`."""
    found: dict[str, Any] = {
        name: getattr(finding.case, name) for name in ("axis", "value", "model")
    }
    found["overrides"] = " ".join(finding.case.overrides)
    found |= {
        item.name: getattr(finding, item.name) for item in fields(finding) if item.name != "case"
    }
    return {
        key: None if isinstance(value, float) and not np.isfinite(value) else value
        for key, value in found.items()
    }


def table(findings: Sequence[Finding]) -> list[list[Any]]:
    """The findings as rows of a table, its head first."""

    def short(value: float | None) -> str | None:
        return None if value is None else f"{value:.1e}"

    return [HEAD] + [
        [
            f.verdict,
            f.case.model,
            f.case.axis,
            f.case.value,
            f"{1e3 * f.amplitude:.4g}" if f.amplitude is not None else None,
            short(f.estimate),
            short(f.error),
            short(f.basis_error),
            short(f.force_error),
            short(f.imbalance),
            f.periods,
            f.why,
        ]
        for f in findings
    ]


def sentences(matrix: Matrix) -> list[str]:
    """What the matrix shows, for the terminal and the report."""
    total = len(matrix.findings)
    counts = ", ".join(f"{matrix.count(verdict)} {verdict}" for verdict in VERDICTS)
    found = [f"{total} runs in {matrix.seconds:.0f} s: {counts}."]
    errors = sorted(
        f.error for f in matrix.findings if f.verdict == CONVERGED and f.error is not None
    )
    if errors:
        middle = errors[len(errors) // 2]
        found.append(
            f"Off from half the step: {middle:.1e} of the amplitude in the middle of the converged runs, "
            f"{errors[-1]:.1e} at most."
        )
    return found + [
        f"silently wrong: {f.case.axis}, {f.case.value} ({f.case.model}): {f.why}"
        for f in matrix.findings
        if f.verdict == WRONG
    ]


@styled
def figure(matrix: Matrix) -> Any:
    """The verdicts: a line for each axis and model, from the ordinary to the absurd."""
    lines: dict[str, list[Finding]] = {}
    for finding in matrix.findings:
        name = finding.case.axis + (
            "" if finding.case.model == "reduced" else f", {finding.case.model} model"
        )
        lines.setdefault(name, []).append(finding)
    widest = max(map(len, lines.values()))
    made = new_figure(3.0 + 1.15 * widest, 0.6 + 0.42 * len(lines))
    axis = made.subplots()
    for y, findings in enumerate(lines.values()):
        for x, finding in enumerate(findings):
            axis.add_patch(_tile(x, y, COLOURS[finding.verdict]))
            words = textwrap.wrap(finding.case.value, 19)[:2]
            axis.text(x + 0.5, y + 0.5, "\n".join(words), ha="center", va="center", fontsize=5.5)
    axis.set(xlim=(0, widest), ylim=(len(lines), 0), xticks=[])
    axis.set_yticks([y + 0.5 for y in range(len(lines))], list(lines), fontsize=8)
    axis.tick_params(length=0)
    axis.grid(False)
    axis.spines[:].set_visible(False)
    keys = [_tile(0, 0, colour) for colour in COLOURS.values()]
    made.legend(
        keys,
        [f"{verdict} ({matrix.count(verdict)})" for verdict in VERDICTS],
        ncols=4,
        loc="outside upper left",
        fontsize=8,
    )
    return made


def _tile(x: float, y: float, colour: str) -> Any:
    from matplotlib.patches import Rectangle

    return Rectangle((x + 0.02, y + 0.04), 0.96, 0.92, facecolor=colour, edgecolor="none")


def write(matrix: Matrix, folder: Path) -> list[Path]:
    """Write report, numbers and picture; the report first.

    Raises:
        OSError: a file cannot be written.
    """
    rows = [row(finding) for finding in matrix.findings]
    picture = folder / "stability.png"
    with atomic_write(picture) as temporary:
        figure(matrix).savefig(temporary, format="png", dpi=130)
    counts = {verdict: matrix.count(verdict) for verdict in VERDICTS}
    summary = {
        "scene": matrix.scene.source,
        "verdicts": counts,
        "seconds": matrix.seconds,
        "runs": rows,
        "schemes": schemes.summary(matrix.by_scheme),
        "provenance": provenance(),
    }
    write_summary(folder / "stability.json", summary)
    write_rows(folder / "stability.csv", rows)
    how = (
        "A run counts as converged if its amplitudes settle and differ from those at half the step by no more than its "
        f"own estimate, which is made from the run at twice the step (differences below {FLOOR:g} count as none); the "
        "columns are relative to the amplitude. Basis: difference from a basis of five modes and all derivatives. "
        "Peak N: of the largest normal force from half the step. Ledger: imbalance of the energies."
    )
    sections: list[tuple[str, list[Any]]] = [
        ("What was found", [*sentences(matrix), how]),
        ("Verdicts", [picture]),
    ]
    for verdict in reversed(VERDICTS):
        chosen = [finding for finding in matrix.findings if finding.verdict == verdict]
        if chosen:
            sections.append((verdict.capitalize(), [table(chosen)]))
    files: list[Path] = []
    if matrix.by_scheme:
        files, about = schemes.write(matrix.by_scheme, folder)
        sections[2:2] = about[:1]
        sections += about[1:]
    sections.append(
        (
            "Made by",
            [
                ", ".join(f"{name} {number}" for name, number in provenance().items())
                or "this program"
            ],
        )
    )
    with atomic_write(folder / "report.html") as temporary:
        temporary.write_text(
            html_report(f"Stability: {matrix.scene.title or matrix.scene.source}", sections),
            encoding="utf-8",
        )
    return [
        folder / name
        for name in ("report.html", "stability.json", "stability.csv", "stability.png")
    ] + files
