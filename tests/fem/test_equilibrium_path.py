"""Equilibrium paths: a block with closed-form limit points and bifurcations, and shallow arches."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq, minimize_scalar
from support import STEEL, beam_scene, needs_mpirun, on_ranks, refusal

pytest.importorskip("dolfinx")

from mpi4py import MPI

from fenicsrom.assess.curves import equilibrium_path as paths
from fenicsrom.assess.curves.equilibrium_path import EquilibriumPath, equilibrium_path
from fenicsrom.errors import ConvergenceError, ErrorKind
from fenicsrom.fem.paths.equilibrium_path import PathPoint
from fenicsrom.fem.solid.solid import build_solid
from fenicsrom.progress import asking
from fenicsrom.scene import Scene, make_scene, read_scene

pytestmark = pytest.mark.slow

YOUNG, LENGTH, HEIGHT, DEPTH = 1e6, 1.0, 1.0, 0.1

BLOCK = """\
Point(1) = {0, -0.5, 0}; Point(2) = {1, -0.5, 0}; Point(3) = {1, 0.5, 0}; Point(4) = {0, 0.5, 0};
Line(1) = {1, 2}; Line(2) = {2, 3}; Line(3) = {3, 4}; Line(4) = {4, 1};
Curve Loop(1) = {1, 2, 3, 4}; Plane Surface(1) = {1};
Transfinite Curve {1, 2, 3, 4} = 2; Transfinite Surface {1}; Recombine Surface {1};
Physical Surface("solid") = {1}; Physical Curve("root") = {4}; Physical Curve("tip") = {2};
Physical Curve("sides") = {1, 3};
"""


def block(folder: Path, size: float = 0.25, **tables: Any) -> Scene:
    """One bilinear cell whose right side is pressed in; its nodes move along x only.

    With the stretch s of the cell, nu = 0 and the St Venant-Kirchhoff material, the force is
    E A s (1 − s²) / 2. The load factor 1 is `size` times E A.
    """
    (folder / "block.geo").write_text(BLOCK)
    push = {"group": "tip", "direction": [-1.0, 0.0], "traction": size * YOUNG}
    given = {
        "geometry": {"mesh": "block.geo", "dimension": 2, "thickness": DEPTH, "degree": 1},
        "material": {"young": YOUNG, "poisson": 0.0, "density": 1.0},
        "supports": [{"group": "root"}, {"group": "sides", "components": ["y"]}],
        "loads": [push],
        "output": {"pictures": False},
    }
    return make_scene(folder=folder, **given | tables)


def follow(scene: Scene, **options: Any) -> EquilibriumPath:
    """The path of a scene, on this rank."""
    return equilibrium_path(scene, MPI.COMM_SELF, **options)


def force(stretch: Any) -> Any:
    """Force of the block on E A."""
    return stretch * (1.0 - stretch**2) / 2.0


@pytest.fixture(scope="module")
def pressed(tmp_path_factory: pytest.TempPathFactory) -> EquilibriumPath:
    """The path of the block."""
    return follow(block(tmp_path_factory.mktemp("block")))


def test_every_equilibrium_of_a_block_is_that_of_its_cubic(pressed: EquilibriumPath) -> None:
    found = pressed
    assert found.reason == "end of the range" and found.points[-1].load_factor == 1.0
    stretch = np.array([1.0 + point.probe[0] / LENGTH for point in found.points])
    assert stretch.max() == 1.0 and stretch.min() < -1.0
    factors = np.array([point.load_factor for point in found.points])
    np.testing.assert_allclose(factors, force(stretch) / 0.25, atol=1e-12)
    assert max(point.residual for point in found.points) < 1e-7


def test_limit_points_and_bifurcations_of_a_block_are_those_in_closed_form(
    pressed: EquilibriumPath,
) -> None:
    """The force is stationary at s² = 1/3.

    The two nodes move against one another, u = xy, where the second variation of the energy
    vanishes, (3s² − 1) / 2L² + 2s²/h² = 0, at s² = 1 / (3 + 4L²/h²).

    Reference: block pressed in: limit points, bifurcations | closed form | ±0.192450, ±0.161985
    EA | agree | 1e-9; 2e-5
    """
    found = pressed
    limit, crossed = np.sqrt(1.0 / 3.0), np.sqrt(1.0 / (3.0 + 4.0 * (LENGTH / HEIGHT) ** 2))
    exact = [(limit, "limit point"), (crossed, "bifurcation")]
    exact += [(-stretch, kind) for stretch, kind in reversed(exact)]
    assert [point.kind for point in found.special] == [kind for _, kind in exact]
    for point, (stretch, kind) in zip(found.special, exact, strict=True):
        close = 1e-9 if kind == "limit point" else 2e-5
        assert point.load_factor == pytest.approx(force(stretch) / 0.25, abs=close)
        assert point.probe[0] == pytest.approx(LENGTH * (stretch - 1.0), abs=5e-5)


def test_path_says_from_where_on_a_block_is_turned_inside_out(pressed: EquilibriumPath) -> None:
    """The volume ratio of the block is its stretch; its other stretches are 1."""
    found = pressed
    stretch = np.array([1.0 + point.probe[0] / LENGTH for point in found.points])
    deformed = [point.deformation for point in found.points]
    np.testing.assert_allclose([each.volume_ratio for each in deformed], stretch, atol=1e-9)
    smallest = [each.smallest_stretch for each in deformed]
    np.testing.assert_allclose(smallest, np.minimum(abs(stretch), 1.0))
    assert found.reason == "end of the range" and deformed[-1].is_inverted
    first = next(point for point, s in zip(found.points, stretch, strict=True) if s <= 0.0)
    (warning,) = found.warnings[-1:]
    assert "inside out" in warning and f"{first.load_factor:.6g} " in warning


def test_large_last_load_factor_misses_nothing_at_the_start(
    pressed: EquilibriumPath, tmp_path: Path
) -> None:
    """The path to a load of 250 million E A has the same limit points and bifurcations."""
    near, far = pressed, follow(block(tmp_path, statics={"last": 1e9}))
    assert far.reason == "end of the range" and far.points[-1].load_factor == 1e9
    assert [point.kind for point in far.special] == [point.kind for point in near.special]
    for one, two in zip(near.special, far.special, strict=True):
        assert two.load_factor == pytest.approx(one.load_factor, abs=1e-3)
    stretch = np.array([1.0 + point.probe[0] / LENGTH for point in far.points])
    factors = np.array([point.load_factor for point in far.points])
    np.testing.assert_allclose(factors, force(stretch) / 0.25, rtol=1e-6, atol=1e-9)


def test_negative_pivots_count_the_unstable_directions(pressed: EquilibriumPath) -> None:
    found = pressed
    stretch = np.array([1.0 + point.probe[0] / LENGTH for point in found.points if not point.kind])
    counts = [point.negative_pivots for point in found.points if not point.kind]
    expected = (stretch**2 < 1.0 / 3.0).astype(int) + (stretch**2 < 1.0 / 7.0)
    assert counts == list(expected)


def test_constant_loads_stay_while_the_others_grow(tmp_path: Path) -> None:
    push = {"group": "tip", "direction": [-1.0, 0.0]}
    loads = [push | {"traction": 0.1 * YOUNG}, push | {"traction": 0.25 * YOUNG}]
    found = follow(block(tmp_path, loads=loads, statics={"loads": [1], "points": 15}))
    assert force(1.0 + found.points[0].probe[0]) == pytest.approx(0.1, rel=1e-9)
    top = (force(np.sqrt(1.0 / 3.0)) - 0.1) / 0.25
    assert found.special[0].load_factor == pytest.approx(top, abs=1e-9)
    assert found.reason == "number of points" and len(found.points) >= 15


def test_load_that_equals_a_varied_one_is_constant() -> None:
    push = {"group": "tip", "direction": [0.0, 1.0], "force": 100.0}
    scene = beam_scene(2, contacts=None, loads=[push, push], statics={"loads": [0]})
    assert paths.varied_loads(scene) == [0]


def test_path_ends_at_a_displacement_of_the_probe(tmp_path: Path) -> None:
    found = follow(block(tmp_path, statics={"displacement": 0.3}))
    assert found.reason == "displacement of the probe"
    assert abs(found.points[-1].probe[0]) >= 0.3 > abs(found.points[-2].probe[0])


@pytest.fixture(scope="module")
def arch() -> Scene:
    return arch_scene(0.02, 0.5, 1000.0, 12)


def arch_scene(rise: float, span: float, force: float, elements: int) -> Scene:
    """A shallow arch, clamped at both ends, with a force on its crown."""
    sizes = {"rise": rise, "span": span, "elements_along": elements}
    return make_scene(
        geometry={
            "mesh": "arch2d.geo",
            "dimension": 2,
            "thickness": 0.01,
            "curved": True,
            "parameters": sizes,
        },
        material=STEEL,
        supports=[{"group": "left"}, {"group": "right"}],
        loads=[{"group": "crown", "direction": [0.0, -1.0], "force": force}],
    )


def test_path_of_an_arch_is_that_of_load_control_and_solves_the_full_equations(arch: Scene) -> None:
    visited: list[PathPoint] = []
    found = follow(arch, visit=visited.append)
    assert [point.kind for point in found.special] == ["limit point"] * 2
    solid = build_solid(arch, MPI.COMM_SELF)
    load = solid.static_load
    for point in visited:
        residual = solid.internal_force(point.displacement) - point.load_factor * load
        assert np.linalg.norm(residual) < 1e-6 * np.linalg.norm(load)
    first = next(k for k, point in enumerate(visited) if point.kind)
    for point in visited[4:first:6]:
        controlled = solid.static(point.load_factor * load)
        size = np.abs(controlled).max()
        np.testing.assert_allclose(point.displacement, controlled, atol=1e-8 * size)


def shallow_arch(rise: float, span: float, section: float) -> Any:
    """Force on the crown of a clamped shallow arch, by its deflection and its axial force.

    E I v'''' + N (v'' + c) = 0 on the left half, for the parabola of curvature c = 8 rise / span²,
    with v = v' = 0 at the end, and v' = 0 and E I v''' = −P/2 at the crown. The second result is
    the residual of N = (E A / span) ∫ (c v − v'²/2) dx. Source: the linearised beam column,
    Timoshenko and Gere, Theory of Elastic Stability, art. 7.
    """
    bending, axial = STEEL["young"] * 0.01 * section**3 / 12.0, STEEL["young"] * 0.01 * section
    curvature, end = 8.0 * rise / span**2, span / 2.0
    x = np.linspace(0.0, end, 2001)

    def solve(deflection: float, thrust: float) -> tuple[float, float]:
        k = np.sqrt(thrust / bending)
        c, s = np.cos(k * end), np.sin(k * end)
        rows = np.array(
            [[1, 0, 1, 0], [0, 1, 0, k], [0, 1, -k * s, k * c], [0, 0, k**3 * s, -(k**3) * c]]
        )
        bent = np.linalg.solve(rows, [0.0, 0.0, curvature * end, 0.0])
        pushed = np.linalg.solve(rows, [0.0, 0.0, 0.0, -0.5 / bending])

        def shape(a: Any, own: float) -> Any:
            v = a[0] + a[1] * x + a[2] * np.cos(k * x) + a[3] * np.sin(k * x) - own * x**2 / 2.0
            slope = a[1] - a[2] * k * np.sin(k * x) + a[3] * k * np.cos(k * x) - own * x
            return np.array([v, slope])

        first, second = shape(bent, curvature), shape(pushed, 0.0)
        size = (deflection - first[0, -1]) / second[0, -1]
        v, slope = first + size * second
        stretch = 2.0 * np.trapezoid(curvature * v - 0.5 * slope**2, x)
        return size, axial / span * stretch - thrust

    return solve


def test_arch_snaps_and_buckles_as_the_beam_column() -> None:
    """Limit points at the extremes of P, bifurcations where N L² / E I = 8.9868² (sideways).

    Reference: shallow clamped arch: limit points | beam column | 146.11, 60.45 N | 145.40, 60.18
    N | 0.6 %

    Reference: shallow clamped arch: sideways buckling | beam column | 120.11, 88.87 N | 118.58,
    89.10 N | 1.5 %
    """
    rise, span, section = 0.03, 1.0, 0.005
    solve = shallow_arch(rise, span, section)
    euler = STEEL["young"] * 0.01 * section**3 / 12.0 * (np.pi / span) ** 2

    def load(deflection: float) -> float:
        bracket = (4.05 * euler, 12.0 * euler)
        thrust = brentq(lambda n: solve(deflection, n)[1], *bracket)
        return float(solve(deflection, thrust)[0])

    sideways = 4.0 * (4.493409457909064 / np.pi) ** 2 * euler
    expected = [
        load(minimize_scalar(lambda v: -load(v), bounds=(0.2 * rise, 0.6 * rise)).x),
        *(
            solve(brentq(lambda v: solve(v, sideways)[1], *bracket), sideways)[0]
            for bracket in ((0.5 * rise, 0.78 * rise), (0.78 * rise, 1.1 * rise))
        ),
        load(minimize_scalar(load, bounds=(rise, 1.4 * rise)).x),
    ]
    found = follow(arch_scene(rise, span, 300.0, 64))
    kinds = ["limit point", "bifurcation", "bifurcation", "limit point"]
    assert [point.kind for point in found.special] == kinds
    np.testing.assert_allclose(
        [300.0 * point.load_factor for point in found.special], expected, rtol=0.015
    )
    limits = [300.0 * point.load_factor for point in found.special[::3]]
    np.testing.assert_allclose(limits, expected[::3], rtol=0.006)


def column(last: float) -> EquilibriumPath:
    """The path of a straight cantilever to so many times its Euler load."""
    euler = np.pi**2 * STEEL["young"] * 0.0254**4 / 12.0 / (4.0 * 2.54**2)
    axial = {"group": "tip", "at": "centre", "direction": [-1.0, 0.0], "force": euler}
    sizes = ("geometry.parameters.elements_along=12", "geometry.parameters.load_at=0.5")
    return follow(beam_scene(2, sizes, contacts=None, loads=[axial], statics={"last": last}))


def test_path_of_a_straight_column_meets_its_euler_loads() -> None:
    """The second Euler load of a cantilever is nine times the first; the column stays straight.

    Reference: bifurcations on the path of a column | Euler | 1 and 9 times π²EI/4L² | 1.003,
    9.11 | 1.5 %
    """
    found = column(10.0)
    assert [point.kind for point in found.special] == ["bifurcation"] * 2
    np.testing.assert_allclose([point.load_factor for point in found.special], [1, 9], rtol=0.015)
    assert max(abs(point.probe[1]) for point in found.points) < 1e-8


def test_special_points_are_as_exact_on_a_path_to_a_large_load() -> None:
    near, far = (column(last).special for last in (10.0, 3000.0))
    for one, two in zip(near, far, strict=False):
        assert two.load_factor == pytest.approx(one.load_factor, rel=5e-4)


DEEP_ARCH = """\
a = 215*Pi/360; thickness = 0.01;
Point(1) = {0, 0, 0};
For i In {0:2}
  For side In {0:1}
    radius = 1 + (side - 0.5)*thickness; angle = Pi/2 + (1 - i)*a;
    Point(2 + 2*i + side) = {radius*Cos(angle), radius*Sin(angle), 0};
  EndFor
  Line(i + 1) = {2 + 2*i, 3 + 2*i};
EndFor
Circle(4) = {2, 1, 4}; Circle(5) = {3, 1, 5}; Circle(6) = {4, 1, 6}; Circle(7) = {5, 1, 7};
Curve Loop(1) = {4, 2, -5, -1}; Plane Surface(1) = {1};
Curve Loop(2) = {6, 3, -7, -2}; Plane Surface(2) = {2};
Transfinite Curve {1, 2, 3} = 2; Transfinite Curve {4, 5, 6, 7} = 61;
Transfinite Surface {1, 2}; Recombine Surface {1, 2};
Physical Surface("solid") = {1, 2}; Physical Curve("crown") = {2}; Physical Curve("right") = {3};
"""


def test_deep_arch_with_a_hinge_collapses_at_the_published_load(tmp_path: Path) -> None:
    """Circular arch of 215 degrees, one end hinged and the other clamped: P = 8.97 E I / R².

    DaDeppo and Schmidt, Journal of Applied Mechanics 42 (1975), for an inextensible arch: the crown
    moves by 0.61 R sideways and by 1.14 R down.

    Reference: circular arch of 215°, hinged and clamped: limit load | DaDeppo and Schmidt (1975)
    | 8.97 EI/R² | 9.039; 8.970 on 240 elements | 1 %
    """
    (tmp_path / "deep.geo").write_text(DEEP_ARCH)
    young, half = 1e9, np.radians(107.5)
    unit = young * 0.01**3 / 12.0
    found = follow(
        make_scene(
            folder=tmp_path,
            geometry={"mesh": "deep.geo", "dimension": 2, "thickness": 1.0, "curved": True},
            material={"young": young, "poisson": 0.0, "density": 1.0},
            supports=[{"node": [-np.sin(half), np.cos(half)]}, {"group": "right"}],
            loads=[{"group": "crown", "direction": [0.0, -1.0], "force": 12.0 * unit}],
            statics={"displacement": 1.35},
        )
    )
    limit = found.special[0]
    assert limit.kind == "limit point"
    assert 12.0 * limit.load_factor == pytest.approx(8.97, rel=0.01)
    np.testing.assert_allclose(limit.probe, [-0.61, -1.14], atol=0.01)


@pytest.mark.parametrize(
    ("tables", "kind", "key"),
    [
        ({"geometrically_nonlinear": False}, ErrorKind.CONFLICT, "geometrically_nonlinear"),
        ({"loads": [], "probe": {"group": "tip"}}, ErrorKind.MISSING, "loads"),
        ({"statics": {"loads": [1]}}, ErrorKind.RANGE, "statics.loads[0]"),
        ({"statics": {"last": 0.0}}, ErrorKind.RANGE, "statics.last"),
        ({"statics": {"lowest": 0.5}}, ErrorKind.RANGE, "statics.lowest"),
    ],
    ids=["linear", "no load", "load number", "last", "lowest"],
)
def test_scene_without_a_path_is_refused(
    tmp_path: Path, tables: dict[str, Any], kind: ErrorKind, key: str
) -> None:
    with refusal(kind, key):
        paths.varied_loads(block(tmp_path, **tables))


def test_path_that_no_place_shows_is_refused(tmp_path: Path) -> None:
    pull = {"direction": [1.0, 0.0], "acceleration": 1.0}
    seen = block(tmp_path, loads=[pull], probe={"group": "tip"})
    with refusal(ErrorKind.MISSING, "probe"):
        paths.varied_loads(replace(seen, probe=None))


def test_harmonic_load_is_no_load_of_a_path(tmp_path: Path) -> None:
    shake = {"group": "tip", "direction": [-1.0, 0.0], "force": 1.0, "frequency": 1.0}
    with refusal(ErrorKind.MISSING, "loads"):
        paths.varied_loads(block(tmp_path, loads=[shake]))
    with refusal(ErrorKind.CONFLICT, "statics.loads[0]"):
        block(tmp_path, loads=[shake], statics={"loads": [0]})


def test_interrupted_path_keeps_its_points(tmp_path: Path) -> None:
    count = 0

    def stop() -> bool:
        nonlocal count
        count += 1
        return count == 5

    with asking(stop):
        found = follow(block(tmp_path))
    assert found.interrupted and found.reason == "interrupted" and len(found.points) == 5


def test_lost_path_says_where(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from fenicsrom.fem.paths.equilibrium_path import PathFollower

    whole = PathFollower._next

    def lost(self: Any, here: PathPoint, guess: Any, step: float) -> PathPoint | None:
        return whole(self, here, guess, step) if here.load_factor < 0.5 else None

    monkeypatch.setattr(PathFollower, "_next", lost)
    found = follow(block(tmp_path))
    assert isinstance(found.unfinished, ConvergenceError) and found.reason == "no convergence"
    assert f"{found.points[-1].load_factor:.6g}" in str(found.unfinished)
    assert found.points[-1].load_factor >= 0.5


TWO_RANKS = """\
import sys
import numpy as np
from mpi4py import MPI
from fenicsrom.assess.curves.equilibrium_path import equilibrium_path
from fenicsrom.scene import read_scene
scene = read_scene(sys.argv[1], sys.argv[3:])
found = equilibrium_path(scene, MPI.COMM_WORLD)
if MPI.COMM_WORLD.rank == 0:
    np.savez(sys.argv[2], factors=[point.load_factor for point in found.points])
"""


@needs_mpirun
def test_path_is_the_same_on_two_ranks(tmp_path: Path) -> None:
    demo = Path(__file__).parents[2] / "demos" / "arch_snap.toml"
    small = ["geometry.parameters.elements_along=8", "statics.displacement=0.004"]
    on_ranks(2, "-c", TWO_RANKS, str(demo), str(tmp_path / "two.npz"), *small)
    one = [point.load_factor for point in follow(read_scene(demo, small)).points]
    with np.load(tmp_path / "two.npz") as two:
        np.testing.assert_allclose(two["factors"], one, rtol=1e-5)
