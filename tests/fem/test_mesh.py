"""Meshes: the beams, the blade, refused files, groups, pieces, and equality on two ranks."""

from __future__ import annotations

import signal
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

pytest.importorskip("dolfinx")
import ufl
from dolfinx import fem
from dolfinx.mesh import compute_midpoints
from mpi4py import MPI
from support import gmsh_session, group_names, refusal

from fenicsrom.errors import ErrorKind, SceneError
from fenicsrom.fem.body.supports import connected_pieces
from fenicsrom.fem.mesh import gmsh_model
from fenicsrom.fem.mesh.mesh import Mesh, build_mesh
from fenicsrom.scene import Geometry, Region
from fenicsrom.scene.reading.reading import shared_meshes

LENGTH, HEIGHT, WIDTH = 2.54, 0.03, 0.02
CUT = {
    (2, "structured"): 1,
    (2, "simplex"): 2,
    (3, "structured"): 1,
    (3, "simplex"): 6,
}  # cells made of each block
SQUARE = [
    (0, 0, 0),
    (1, 0, 0),
    (1, 1, 0),
    (0, 1, 0),
    (2, 0, 0),
    (2, 1, 0),
]  # two unit squares side by side
BEAMS = [(*beam, curved) for beam, curved in zip(CUT, (False, True, True, False), strict=True)]
LINE, TRIANGLE, QUADRILATERAL, TETRAHEDRON, QUADRILATERAL9 = 1, 2, 3, 4, 10  # gmsh types


def beam(
    dimension: int, cells: str = "structured", curved: bool = False, **parameters: float
) -> Mesh:
    """The program's own beam."""
    size = {"length": LENGTH, "height": HEIGHT, "width": WIDTH}
    size = {name: size[name] for name in ("length", "height", "width")[:dimension]}
    return build_mesh(
        Geometry(
            mesh=shared_meshes() / f"beam{dimension}d.geo",
            dimension=dimension,
            cells=cells,
            curved=curved,
            parameters=size | parameters,
        ),
        MPI.COMM_WORLD,
    )


def read(path: Path, dimension: int = 2, **keys: object) -> Mesh:
    """A mesh file."""
    return build_mesh(Geometry(mesh=path, dimension=dimension, **keys), MPI.COMM_WORLD)


def write_msh(
    path: Path,
    points: Sequence[Sequence[float]],
    elements: Sequence[tuple[int, int, Sequence[int]]],
    names: Sequence[tuple[int, int, str]] = ((2, 1, "solid"), (1, 2, "root"), (1, 3, "tip")),
) -> Path:
    """Write a mesh in gmsh's format 2.2: elements are (gmsh type, physical number, nodes from
    0)."""
    lines = ["$MeshFormat", "2.2 0 8", "$EndMeshFormat", "$PhysicalNames", str(len(names))]
    lines += [f'{dimension} {number} "{name}"' for dimension, number, name in names]
    lines += ["$EndPhysicalNames", "$Nodes", str(len(points))]
    lines += [f"{i} {' '.join(map(repr, map(float, point)))}" for i, point in enumerate(points, 1)]
    lines += ["$EndNodes", "$Elements", str(len(elements))]
    for i, (kind, group, nodes) in enumerate(elements, 1):
        lines.append(f"{i} {kind} 2 {group} {group} {' '.join(str(node + 1) for node in nodes)}")
    path.write_text("\n".join([*lines, "$EndElements", ""]))
    return path


def squares(*more: tuple[int, int, Sequence[int]]) -> list[tuple[int, int, Sequence[int]]]:
    """The two squares with their outer edges, and more elements."""
    cells = [(QUADRILATERAL, 1, (0, 1, 2, 3)), (QUADRILATERAL, 1, (1, 4, 5, 2))]
    return [*cells, (LINE, 2, (0, 3)), (LINE, 3, (4, 5)), *more]


def integral(mesh: Mesh, integrand: object, measure: ufl.Measure | None = None) -> float:
    """Integral over the cells or over a measure, on all ranks."""
    measure = ufl.dx(domain=mesh.domain) if measure is None else measure
    integrand = fem.Constant(mesh.domain, float(integrand)) if np.isscalar(integrand) else integrand
    return mesh.domain.comm.allreduce(fem.assemble_scalar(fem.form(integrand * measure)))


@pytest.mark.parametrize(("dimension", "cells", "curved"), BEAMS)
def test_beam_mesh_has_its_size_and_groups(dimension: int, cells: str, curved: bool) -> None:
    through = 2
    mesh = beam(dimension, cells, curved, elements_along=10, elements_through=through, load_at=0.52)
    section = HEIGHT * (WIDTH if dimension == 3 else 1.0)
    blocks = 10 * through ** (dimension - 1)
    assert mesh.domain.topology.index_map(dimension).size_global == CUT[dimension, cells] * blocks
    assert mesh.domain.geometry.dim == mesh.domain.topology.dim == dimension
    assert mesh.domain.ufl_domain().ufl_coordinate_element().degree == (2 if curved else 1)
    assert not mesh.warnings
    assert integral(mesh, 1.0) == pytest.approx(LENGTH * section, rel=1e-12)
    x = ufl.SpatialCoordinate(mesh.domain)
    for name, place in (("root", 0.0), ("load", 0.52 * LENGTH), ("tip", LENGTH)):
        surface = mesh.surface(name)
        assert integral(mesh, 1.0, surface) == pytest.approx(section, rel=1e-12)
        assert integral(mesh, x[0], surface) == pytest.approx(place * section, rel=1e-12, abs=1e-15)
        assert integral(mesh, x[1], surface) == pytest.approx(0.0, abs=1e-15)
        assert len(mesh.facets(name)) == (
            through if dimension == 2 else through**2 * (2 if cells == "simplex" else 1)
        )
    middle = compute_midpoints(
        mesh.domain, dimension, np.arange(CUT[dimension, cells] * blocks, dtype=np.int32)
    )
    assert (
        np.sum(middle[:, 0] < 0.52 * LENGTH) == CUT[dimension, cells] * blocks // 2
    )  # round(5.2) of 10 elements


@pytest.mark.parametrize(
    ("dimension", "name", "value"),
    [(2, "length", -1.0), (3, "elements_along", 2.5), (3, "width", -1.0), (2, "load_at", 0.01)],
)
def test_wrong_parameter_is_refused(dimension: int, name: str, value: float) -> None:
    with refusal(ErrorKind.RANGE, f"geometry.parameters.{name}", f"beam{dimension}d.geo"):
        beam(dimension, **{name: value})


def test_unknown_parameter_is_refused_with_known_names() -> None:
    known = "elements_along, elements_through, height, length, load_at"
    for name in ("size", "structured"):
        key = f"geometry.parameters.{name}"
        with refusal(ErrorKind.UNKNOWN_KEY, key, "beam2d.geo", names=known):
            beam(2, **{name: 1.0})


def test_huge_mesh_does_not_disturb_the_next_mesh() -> None:
    """Gmsh scales its tolerances by the extent of the last model of the process, and would merge
    points of the next model."""
    before = [integral(beam(dimension), 1.0) for dimension in (2, 3)]
    with refusal(ErrorKind.MESH, file="beam2d.geo"):
        beam(2, length=1e15)
    for dimension in (2, 3):
        after = beam(dimension)
        assert not after.warnings
        assert integral(after, 1.0) == pytest.approx(before[dimension - 2])


def blade(cells: str = "structured", curved: bool = True, **parameters: float) -> Mesh:
    """The program's own blade."""
    path = shared_meshes() / "blade.geo"
    return build_mesh(
        Geometry(mesh=path, dimension=3, cells=cells, curved=curved, parameters=parameters),
        MPI.COMM_WORLD,
    )


def profile(u: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Thickness of the NACA four-digit profiles with a closed trailing edge, relative to the
    largest."""
    return (0.2969 * np.sqrt(u) - 0.126 * u - 0.3516 * u**2 + 0.2843 * u**3 - 0.1036 * u**4) / 0.1


@pytest.mark.parametrize(("cells", "curved"), [("structured", True), ("simplex", False)])
def test_blade_mesh_has_its_groups(cells: str, curved: bool) -> None:
    mesh = blade(cells, curved)
    assert not mesh.warnings
    cut = {"structured": (1, 1), "simplex": (6, 2)}[cells]
    assert mesh.domain.topology.index_map(3).size_global == 12 * 8 * cut[0]
    facets = {name: len(mesh.facets(name)) for name in mesh.facet_groups}
    skin = 12 * 8 * cut[1]
    assert facets == dict.fromkeys(("root", "load", "tip"), 8 * cut[1]) | {
        "pressure": skin,
        "suction": skin,
    }
    x = ufl.SpatialCoordinate(mesh.domain)
    for name, place in (("root", 0.0), ("load", 0.75 * 0.7), ("tip", 0.7)):
        area = integral(mesh, 1.0, mesh.surface(name))
        assert integral(mesh, x[0], mesh.surface(name)) == pytest.approx(
            place * area, rel=1e-12, abs=1e-15
        )
    topology = mesh.domain.topology
    topology.create_connectivity(2, 3)
    for name in facets:
        cells_of = {len(topology.connectivity(2, 3).links(facet)) for facet in mesh.facets(name)}
        assert cells_of == ({2} if name == "load" else {1})
    vertices, edges = mesh.node_groups["tip_nodes"]
    topology.create_connectivity(2, 0)
    topology.create_connectivity(1, 0)
    assert (len(vertices), len(edges)) == (9, 8)
    for name in ("tip", "pressure"):
        assert set(vertices) < {
            v for facet in mesh.facets(name) for v in topology.connectivity(2, 0).links(facet)
        }
    assert set(vertices) == {v for edge in edges for v in topology.connectivity(1, 0).links(edge)}


@pytest.mark.slow
def test_blade_mesh_has_the_given_shape() -> None:
    size = {
        "span": 0.6,
        "chord": 0.2,
        "tip_chord": 0.1,
        "thickness": 0.08,
        "tip_thickness": 0.04,
        "camber": 0.05,
    }
    turn = {
        "camber_at": 0.3,
        "edge": 0.3,
        "stagger": 20,
        "twist": 40,
        "sweep": 0.05,
        "lean": -0.02,
        "load_at": 0.5,
    }
    mesh = blade(elements_along=16, elements_across=16, **size, **turn)
    u = np.linspace(0.0, 1.0, 200_001)
    steep = 2 * 0.05 * (0.3 - u) / np.where(u < 0.3, 0.3, 0.7) ** 2
    weight = (0.3 + 0.7 * profile(u)) * np.hypot(1.0, steep)
    unit = np.trapezoid(weight, u)  # area of a section of unit chord and thickness
    for name, t in (("root", 0.0), ("load", 0.5), ("tip", 1.0)):
        chord, thick, angle = 0.2 - 0.1 * t, 0.08 - 0.04 * t, np.radians(20 + 40 * t)
        area = integral(mesh, 1.0, mesh.surface(name))
        assert area == pytest.approx(thick * chord**2 * unit, rel=5e-3)
        x = ufl.SpatialCoordinate(mesh.domain)
        along = np.cos(angle) * (x[1] - 0.05 * t**2) + np.sin(angle) * (x[2] + 0.02 * t**2)
        above = np.cos(angle) * (x[2] + 0.02 * t**2) - np.sin(angle) * (x[1] - 0.05 * t**2)
        line = np.where(u < 0.3, (0.6 * u - u**2) / 0.3**2, (0.4 + 0.6 * u - u**2) / 0.7**2) * 0.05
        pairs = (
            (along / chord, u - 0.5),
            (above / chord, line),
            (along * above / chord**2, (u - 0.5) * line),
        )
        for (measured, exact), tolerance in zip(pairs, (2e-3, 2e-3, 5e-4), strict=True):
            mean = np.trapezoid(weight * exact, u) / unit
            assert integral(mesh, measured, mesh.surface(name)) / area == pytest.approx(
                mean, abs=tolerance
            )
    t = np.linspace(0.0, 1.0, 1001)
    volume = np.trapezoid((0.08 - 0.04 * t) * (0.2 - 0.1 * t) ** 2, t) * 0.6 * unit
    assert integral(mesh, 1.0) == pytest.approx(volume, rel=3e-3)


@pytest.mark.parametrize(
    ("name", "value"), [("span", 0.0), ("thickness", 0.31), ("twist", -91.0), ("load_at", 0.99)]
)
def test_wrong_parameter_of_blade_is_refused(name: str, value: float) -> None:
    with refusal(ErrorKind.RANGE, f"geometry.parameters.{name}", "blade.geo"):
        blade(**{name: value})


def test_blade_too_thin_for_its_curves_is_refused() -> None:
    with refusal(ErrorKind.MESH, file="blade.geo"):
        blade("simplex", thickness=0.01, tip_thickness=0.01, twist=80, elements_along=4)


def test_parameters_are_found_among_comments(tmp_path: Path) -> None:
    path = tmp_path / "square.geo"
    path.write_text(
        '// DefineConstant[ commented = 1 ]; /* "\n'
        'DefineConstant[ side = {1, Min 0, Max 9, Name "a, b = 3 // not a comment"}, '
        "/* other = 2, */ lonely ];\n"
        'SetFactory("OpenCASCADE"); Rectangle(1) = {0, 0, 0, side, side};\n'
        'Physical Curve("root") = {4};\n'
    )
    mesh = read(path, cells="simplex", parameters={"side": 3.0})
    assert integral(mesh, 1.0) == pytest.approx(9.0)
    known = "lonely, side"
    with refusal(ErrorKind.UNKNOWN_KEY, "geometry.parameters.other", path.name, names=known):
        read(path, cells="simplex", parameters={"other": 3.0})
    with refusal(ErrorKind.CONFLICT, "geometry.cells", path.name, names="Triangle"):
        read(path, cells="structured")
    path.write_text(path.read_text().replace("DefineConstant[ side", "//"))
    none = "no DefineConstant"
    with refusal(ErrorKind.UNKNOWN_KEY, "geometry.parameters.side", path.name, names=none):
        read(path, cells="simplex", parameters={"side": 3.0})


def test_error_in_geometry_names_first_line_and_leaves_gmsh_usable(tmp_path: Path) -> None:
    path = tmp_path / "wrong.geo"
    path.write_text("Point(1) = {0, 0, nothing};\nLine(1) = {1, 7};\nBogus(3;\n")
    for _ in range(2):
        with refusal(ErrorKind.MESH, file="wrong.geo", names="'nothing'"):
            read(path)
    assert beam(2).facets("tip").size == 1


@pytest.mark.parametrize(
    ("name", "said"), [("absent.msh", "no such file"), ("present.stl", ".geo, .msh")]
)
def test_missing_or_unknown_file_is_refused(tmp_path: Path, name: str, said: str) -> None:
    (tmp_path / "present.stl").touch()
    with refusal(ErrorKind.FILE, "geometry.mesh", name, names=said):
        read(tmp_path / name)


def test_file_without_mesh_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "rubbish.msh"
    path.write_text("rubbish\n")
    with refusal(ErrorKind.FORMAT, file="rubbish.msh"):
        read(path)


def test_mesh_of_another_dimension_is_refused() -> None:
    with refusal(ErrorKind.CONFLICT, "geometry.dimension", "beam2d.geo"):
        read(shared_meshes() / "beam2d.geo", 3)


def test_missing_group_is_refused_with_known_names() -> None:
    mesh = beam(2)
    for ask in (mesh.facets, mesh.surface):
        with refusal(ErrorKind.PLACE, file="beam2d.geo", names="load, root, tip"):
            ask("rot")
    with refusal(ErrorKind.PLACE, file="beam2d.geo", names="'solid'"):
        mesh.facets("solid")


def test_mesh_without_facet_groups_is_read(tmp_path: Path) -> None:
    mesh = read(write_msh(tmp_path / "two.msh", SQUARE, squares()[:2], [(2, 1, "solid")]))
    assert mesh.cell_groups.keys() == {"solid"} and not mesh.facet_groups and not mesh.node_groups
    left = Region(box=((0.0, 0.0), (0.0, 1.0)))
    assert integral(mesh, 1.0, mesh.surface(left)) == pytest.approx(1.0)
    with refusal(ErrorKind.PLACE, file="two.msh", names="'root'"):
        mesh.facets("root")


def test_groups_of_points_and_curves_become_node_groups(tmp_path: Path) -> None:
    with gmsh_session() as gmsh:
        gmsh.merge(str(shared_meshes() / "beam3d.geo"))
        gmsh.model.mesh.generate(3)
        gmsh.model.addPhysicalGroup(0, [1, 2], name="points")
        gmsh.model.addPhysicalGroup(1, [1, 2], name="curves")
        gmsh.model.addPhysicalGroup(0, [1], name="curves")
        gmsh.write(str(tmp_path / "beam.msh"))
    mesh = read(tmp_path / "beam.msh", 3)
    numbers = {
        name: (len(vertices), len(edges)) for name, (vertices, edges) in mesh.node_groups.items()
    }
    assert numbers == {"points": (2, 0), "curves": (3, 2)}
    space = fem.functionspace(mesh.domain, ("Lagrange", 2))
    x = np.sort(space.tabulate_dof_coordinates()[mesh.nodes("curves", space)] / 0.0127, axis=0)
    assert np.allclose(x.T, [[0, 0, 0, 0, 0], [-1, 0, 1, 1, 1], [-1, -1, -1, 0, 1]])
    assert not mesh.has_facets("points") and mesh.has_facets("root")
    with refusal(ErrorKind.PLACE, file="beam.msh", names="'points'"):
        mesh.facets("points")


def test_facet_in_two_groups_is_in_both(tmp_path: Path) -> None:
    edges = [(LINE, 4, edge) for edge in ((0, 3), (0, 1), (1, 4))]
    mesh = read(write_msh(tmp_path / "two.msh", SQUARE, squares(*edges)))
    assert integral(mesh, 1.0, mesh.surface("4")) == pytest.approx(3.0)
    assert integral(mesh, 1.0, mesh.surface("root")) == pytest.approx(1.0)
    assert set(mesh.facets("root")) < set(mesh.facets("4"))
    assert not mesh.warnings


@pytest.mark.slow
def test_cells_are_those_of_solid_group_or_all(tmp_path: Path) -> None:
    elements = [
        (QUADRILATERAL, 4, nodes) if kind == QUADRILATERAL and 4 in nodes else (kind, group, nodes)
        for kind, group, nodes in squares()
    ]
    edges = [(1, 2, "root"), (1, 3, "tip")]
    mesh = read(
        write_msh(
            tmp_path / "two.msh", SQUARE, elements, [(2, 1, "steel"), (2, 4, "brass"), *edges]
        )
    )
    assert integral(mesh, 1.0) == pytest.approx(2.0)
    path = write_msh(
        tmp_path / "one.msh", SQUARE, elements, [(2, 1, "solid"), (2, 4, "air"), *edges]
    )
    mesh = read(path)
    assert integral(mesh, 1.0) == pytest.approx(1.0)
    assert group_names(mesh) == {"solid", "root"}
    assert mesh.warnings == (
        f"{path}: group 'tip': 1 of 1 facets are not facets of a cell and are left out",
    )


def test_facet_across_a_cell_is_left_out_with_warning(tmp_path: Path) -> None:
    mesh = read(write_msh(tmp_path / "two.msh", SQUARE, squares((LINE, 2, (0, 2)))))
    assert len(mesh.facets("root")) == 1
    assert "group 'root': 1 of 2 facets are not facets of a cell" in mesh.warnings[0]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("points", "elements", "key", "names"),
    [
        (SQUARE, squares((LINE, 1, (0, 1))), "", "'solid'"),
        (SQUARE, [(QUADRILATERAL, 1, (0, 1, 3, 2)), *squares()[1:]], "", "1 cell "),
        ([*SQUARE[:5], (2, 1, 0.1)], squares(), "geometry.dimension", "0.1 m"),
    ],
)
def test_damaged_mesh_is_refused(
    tmp_path: Path, points: list, elements: list, key: str, names: str
) -> None:
    groups = [(2, 1, "solid"), (1, 1, "solid"), (1, 2, "root"), (1, 3, "tip")]
    path = write_msh(tmp_path / "wrong.msh", points, elements, groups)
    with refusal(ErrorKind.MESH, key, path.name, names):
        read(path)


def test_clockwise_cells_are_read(tmp_path: Path) -> None:
    elements = [(QUADRILATERAL, 1, (3, 2, 1, 0)), (QUADRILATERAL, 1, (2, 5, 4, 1)), *squares()[2:]]
    mesh = read(write_msh(tmp_path / "two.msh", SQUARE, elements))
    assert integral(mesh, 1.0) == pytest.approx(2.0)


def test_unsupported_cells_and_facets_are_refused(tmp_path: Path) -> None:
    points = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (0, 1, 1)]
    names = [(3, 1, "solid"), (2, 2, "root")]
    elements = [(TETRAHEDRON, 1, range(4)), (QUADRILATERAL, 2, (0, 1, 4, 3))]
    with refusal(ErrorKind.MESH, file="tetrahedron.msh", names="Quadrilateral 4"):
        read(write_msh(tmp_path / "tetrahedron.msh", points, elements, names), 3)


def test_curved_disc_has_its_area(tmp_path: Path) -> None:
    path = tmp_path / "disc.geo"
    path.write_text(
        'SetFactory("OpenCASCADE"); Disk(1) = {0, 0, 0, 1}; MeshSize{:} = 0.5;\n'
        'Physical Curve("root") = Boundary{ Surface{1}; };\n'
    )
    straight, curved = (read(path, cells="simplex", curved=curved) for curved in (False, True))
    edges = len(straight.facets("root"))
    assert integral(straight, 1.0) == pytest.approx(edges / 2 * np.sin(2 * np.pi / edges), rel=1e-6)
    assert integral(curved, 1.0) == pytest.approx(np.pi, rel=1e-3)
    assert integral(curved, 1.0, curved.surface("root")) == pytest.approx(2 * np.pi, rel=1e-3)


@pytest.mark.slow
def test_curved_file_keeps_its_curved_cells(tmp_path: Path) -> None:
    h = 0.1  # the cell [-1, 1]² with its right edge bulged by h: the area grows by 2/3 · 2 h
    corners = [(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)]
    points = [*corners, (0, -1, 0), (1 + h, 0, 0), (0, 1, 0), (-1, 0, 0), (0, 0, 0)]
    elements = [(QUADRILATERAL9, 1, range(9)), (8, 2, (0, 3, 7)), (8, 3, (1, 2, 5))]
    path = write_msh(tmp_path / "bulged.msh", points, elements)
    curved, straight = read(path, curved=True), read(path)
    assert integral(curved, 1.0) == pytest.approx(4 + 4 / 3 * h)
    assert not curved.warnings
    assert integral(straight, 1.0) == pytest.approx(4.0)
    assert (
        "curved cells are made straight, which moves a node by up to 4.8 % of the size of its cell"
        in straight.warnings[0]
    )
    points[5] = (1 + 1e-5, 0, 0)  # as a deck with eight characters in a field rounds it
    assert not read(write_msh(tmp_path / "rounded.msh", points, elements)).warnings
    with refusal(ErrorKind.CONFLICT, "geometry.curved", "two.msh", names="Quadrilateral 9"):
        read(write_msh(tmp_path / "two.msh", SQUARE, squares()), curved=True)


def test_pieces_that_share_no_node_are_counted(tmp_path: Path) -> None:
    assert connected_pieces(beam(2))[1] == 1
    doubled = [*SQUARE, (1, 0, 0), (1, 1, 0)]  # the second square has its own nodes at x = 1
    elements = [squares()[0], (QUADRILATERAL, 1, (6, 4, 5, 7)), *squares()[2:]]
    mesh = read(write_msh(tmp_path / "two.msh", doubled, elements))
    assert connected_pieces(mesh)[1] == 2


def test_settings_of_gmsh_are_restored(monkeypatch: pytest.MonkeyPatch) -> None:
    import gmsh

    seen, check = [], gmsh_model.check_cells

    def spy(*arguments: Any) -> Any:
        seen.append(signal.getsignal(signal.SIGINT))
        return check(*arguments)

    monkeypatch.setattr(gmsh_model, "check_cells", spy)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    beam(2)
    assert seen == [signal.default_int_handler]
    with pytest.raises(SceneError):
        beam(2, length=-1.0)
    assert not gmsh.isInitialized()
    with gmsh_session(), pytest.raises(RuntimeError, match=r"gmsh\.finalize"):
        beam(2)
