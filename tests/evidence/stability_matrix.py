"""The stability matrix of the demo beam: 155 extreme runs and the verdict on each.

    python3 tests/evidence/stability_matrix.py --output DIR

`fenicsrom stability SCENE` drives any scene along axes that follow from the scene's own values.
This script drives the demo `slip_liftoff_2d` along axes in absolute numbers, and along axes that
belong to the geometry of the beam: slenderness, nearly coincident modes, units, distorted meshes,
curved surfaces and contact at the clamp. The full model and the beam run some of the cases too. Two
processes need about an hour.
"""

from __future__ import annotations

import argparse
import logging
import sys
import tempfile
import time as clock
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from fenicsrom.assess.studies.stability import WORKERS, Case, Matrix, Verdict, load, run_all
from fenicsrom.post.studies.stability_report import report

SCENE = Path(__file__).parents[2] / "demos" / "slip_liftoff_2d.toml"

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
)  # the plane is across the swing: the tip hits it at speed
PAPER = {
    "slip and lift-off": (),
    "stick and slip": (LOAD + "frequency=8.1", CONTACT + "preload=250"),
    "high load": (LOAD + "force=333.3", CONTACT + "preload=200"),
    "500 N, 20 N": CRITICAL,
}

BUCKLING = 2745.7  # N, Euler's load of the beam, clamped and free
CASING = "{{kind='cylinder', point=[{centre!r}, 0.0], inside={inside}}}"


def round_surface(radius: float, inside: bool = True) -> tuple[str, ...]:
    """A curved surface at the tip: a casing around the beam, or a shaft beyond it; radius in m."""
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
    # three modes: a soft beam has so many modes below the load that "auto" takes a dozen
    "Young's modulus": {
        f"{e:g} Pa": (f"material.young={e!r}", "basis.modes=3") for e in (1e3, 1e7, 1e9, 1e13)
    },
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

# axis -> values: with the default scheme the reduced model does not become periodic
UNSTEADY: dict[str, tuple[str, ...]] = {
    "load": ("30 times",),
    "damping": ("0 1/s", "0.1 1/s"),
    "impact": ("gap 20 mm, 1e+08 N/m",),
    "worst pairs": ("impact, 1e10 N/m, 50 steps",),
}

# axis -> values: the full model and the beam run these cases too
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
    """The beam with another L/h, at the same frequency ratio and the same relative loads."""
    s = 100.0 / ratio
    bending = s**3  # factor of the bending stiffness; the width is unchanged
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
    """The beam of the scene in units of this many m, kg and s."""
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
    """The same beam in 3D; if width and height are equal, every bending frequency is double."""
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
SHIFTS = (0.2, 0.45, 0.6)  # in cell lengths: cells are inverted beyond 0.5


def cases(folder: Path) -> Iterator[Case]:
    """All cases; the distorted meshes are written to `folder`."""
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


def is_unsteady(case: Case) -> bool:
    """Whether the reduced model does not become periodic with the default scheme."""
    return case.model == "reduced" and case.value in UNSTEADY.get(case.axis, ())


def zigzag_mesh(
    path: Path, shift: float, along: int = 20, length: float = 2.54, height: float = 0.0254
) -> Path:
    """Write a mesh of the beam, one cell high, with nodes shifted by a fraction of a cell."""
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


def main() -> int:
    """Run the matrix, write the report, and return 1 if a run is silently wrong."""
    parser = argparse.ArgumentParser(description="The stability matrix of the demo beam.")
    parser.add_argument("--output", default="out/stability_matrix", type=Path, metavar="DIR")
    parser.add_argument("--axis", action="append", help="run this axis only; may be repeated")
    parser.add_argument(
        "--set", action="append", default=[], metavar="KEY=VALUE", help="override for every run"
    )
    parser.add_argument(
        "--unsteady",
        action="store_true",
        help="run only the cases that do not become periodic with the default scheme",
    )
    options = parser.parse_args()
    table, scene = load(SCENE, options.set)
    begin = clock.perf_counter()
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    with tempfile.TemporaryDirectory(prefix="fenicsrom_") as folder:
        wanted = [
            case
            for case in cases(Path(folder))
            if (not options.axis or case.axis in options.axis)
            and (not options.unsteady or is_unsteady(case))
        ]
        findings = run_all(wanted, table, scene.source, SCENE.parent, WORKERS)
    matrix = Matrix(scene, findings, clock.perf_counter() - begin)
    found = report(matrix)
    print("\n".join([found.text(), *map(str, found.write(options.output))]))
    return 1 if matrix.count(Verdict.WRONG) else 0


if __name__ == "__main__":
    sys.exit(main())
