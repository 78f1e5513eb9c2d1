"""Imported geometry: Abaqus, Nastran, VTK and STEP files, node groups, and regions picked by
coordinates."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("dolfinx")
pytest.importorskip("meshio")
import meshio
import ufl
from dolfinx import fem
from mpi4py import MPI
from support import gmsh_session, group_names, needs_mpirun, on_ranks, refusal, step_file, touching

from fenicsrom.errors import ErrorKind, SceneError
from fenicsrom.fem.mesh.inspection import inspect
from fenicsrom.fem.mesh.mesh import Mesh, build_mesh
from fenicsrom.fem.solid.solid import solid_of
from fenicsrom.post.paraview.vtk import Attached, Grid, write_vtu
from fenicsrom.scene import Geometry, Plane, Region, Scene, parse_scene
from fenicsrom.scene.reading.reading import shared_meshes

CELLS = {
    "triangle": 2,
    "triangle6": 2,
    "quad": 2,
    "quad8": 2,
    "quad9": 2,
    "tetra": 3,
    "tetra10": 3,
    "hexahedron": 3,
    "hexahedron20": 3,
    "hexahedron27": 3,
}
QUADRATIC = {"triangle6", "quad8", "quad9", "tetra10", "hexahedron20", "hexahedron27"}
FILES = [
    (kind, suffix)
    for kind in CELLS
    for suffix in (".inp", ".bdf", ".vtu")
    if (kind in QUADRATIC or suffix == ".inp")
    and (kind, suffix) not in (("hexahedron27", ".inp"), ("hexahedron27", ".bdf"))
]
FILES += [
    ("quad8", ".msh"),
    ("hexahedron20", ".msh"),
    ("hexahedron20", ".unv"),
    ("tetra10", ".vtk"),
]


def read(path: Path, dimension: int = 3, **keys: Any) -> Mesh:
    """A mesh file."""
    return build_mesh(Geometry(mesh=path, dimension=dimension, **keys), MPI.COMM_WORLD)


def write_msh(path: Path, kind: str, incomplete: bool, straight: bool = False) -> Path:
    """A unit cube or square of 2 cells each way, bent by a quadratic map; coordinates are multiples
    of 1/128."""
    dimension = CELLS[kind]
    with gmsh_session() as gmsh:
        gmsh.merge(str(shared_meshes() / f"beam{dimension}d.geo"))
        gmsh.clear()
        gmsh.parser.setNumber("structured", [float(kind.startswith(("quad", "hexa")))])
        sizes = {
            "length": 1,
            "height": 1,
            "width": 1,
            "elements_along": 2,
            "elements_through": 2,
            "load_at": 0.5,
        }
        for name, value in sizes.items():
            gmsh.parser.setNumber(name, [value])
        gmsh.merge(str(shared_meshes() / f"beam{dimension}d.geo"))
        gmsh.model.mesh.generate(dimension)
        if kind in QUADRATIC:
            gmsh.option.setNumber("Mesh.SecondOrderIncomplete", float(incomplete))
            gmsh.model.mesh.setOrder(2)
        numbers, points, _ = gmsh.model.mesh.getNodes()
        for number, point in zip(numbers, points.reshape(-1, 3), strict=True):
            x, y, z = np.round(point * 4) / 4
            bent = (
                x + y * y / 8,
                y + (x * z / 8 if dimension == 3 else x * x / 8),
                z + (dimension == 3) * x * x / 8,
            )
            gmsh.model.mesh.setNode(number, [x, y, z] if straight else bent, [])
        gmsh.write(str(path))
    return path


def convert(source: Path, path: Path, kind: str) -> Path:
    """The same mesh in another format; root and tip become node sets, shells with a property, or
    integer fields."""
    if path.suffix in (".msh", ".unv"):
        with gmsh_session() as gmsh:
            gmsh.merge(str(source))
            gmsh.write(str(path))
        return path
    mesh = meshio.read(source)
    cells = np.concatenate([block.data for block in mesh.cells if block.type == kind])
    used, cells = np.unique(cells, return_inverse=True)
    points, cells = mesh.points[used], cells.reshape(-1, meshio._mesh.num_nodes_per_cell[kind])
    sets = {name: np.flatnonzero(near) for name, near in nodes_of(mesh, used).items()}
    blocks = [(kind, cells)]
    if path.suffix == ".inp":
        meshio.Mesh(points, blocks, point_sets=sets).write(path)
        path.write_text(path.read_text().replace("CAX4P", "CPS4"))
    elif path.suffix in (".vtu", ".vtk"):
        data = {
            name: np.isin(np.arange(len(points)), nodes).astype(np.int32)
            for name, nodes in sets.items()
        }
        meshio.Mesh(points, blocks, point_data=data).write(path)
    else:
        references = [np.full(len(cells), 9)]
        for property_id, name in ((1, "root"), (2, "tip")):
            for facet, index in mesh.cell_sets_dict[name].items():
                if facet != "line3":  # Nastran has none
                    blocks.append((facet, np.searchsorted(used, mesh.cells_dict[facet][index])))
                    references.append(np.full(len(index), property_id))
        meshio.Mesh(points, blocks, cell_data={"nastran:ref": references}).write(path)
    return path


def nodes_of(mesh: Any, used: Any) -> dict[str, Any]:
    """Which of the used nodes are in the groups root and tip."""
    found = {}
    for name in ("root", "tip"):
        rows = [
            mesh.cells_dict[kind][index].ravel()
            for kind, index in mesh.cell_sets_dict[name].items()
        ]
        found[name] = np.isin(used, np.concatenate(rows))
    return found


def stiffness(mesh: Mesh) -> tuple[Any, Any]:
    """A dense stiffness of degree 2, with the nodes sorted by their coordinates, and these
    coordinates."""
    d = mesh.domain.geometry.dim
    space = fem.functionspace(mesh.domain, ("Lagrange", 2, (d,)))
    u, v = ufl.TrialFunction(space), ufl.TestFunction(space)
    strain = ufl.sym(ufl.grad(u))
    form = 1.4 * ufl.inner(strain, ufl.grad(v)) + 1.3 * ufl.div(u) * ufl.div(v)
    matrix = fem.assemble_matrix(
        fem.form(form * ufl.dx(metadata={"quadrature_degree": 6}))
    ).to_dense()
    x = space.tabulate_dof_coordinates()
    order = np.lexsort(np.round(x, 9).T)
    rows = (order[:, None] * d + np.arange(d)).ravel()
    return matrix[np.ix_(rows, rows)], x[order]


def integral(mesh: Mesh, integrand: Any, measure: ufl.Measure | None = None) -> float:
    """Integral over the cells or over a measure, on all ranks."""
    measure = ufl.dx(domain=mesh.domain) if measure is None else measure
    integrand = fem.Constant(mesh.domain, float(integrand)) if np.isscalar(integrand) else integrand
    return float(mesh.domain.comm.allreduce(fem.assemble_scalar(fem.form(integrand * measure))))


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "suffix"), FILES)
def test_stiffness_of_each_format_matches_gmsh(tmp_path: Path, kind: str, suffix: str) -> None:
    d, curved = CELLS[kind], kind in QUADRATIC
    complete = write_msh(tmp_path / "complete.msh", kind, False)
    own = write_msh(tmp_path / "own.msh", kind, kind in ("quad8", "hexahedron20"))
    other = read(convert(own, tmp_path / f"other{suffix}", kind), d, curved=curved)
    expected, x = stiffness(read(complete, d, curved=curved))
    found, y = stiffness(other)
    assert not [text for text in other.warnings if "do not bend" not in text]
    assert x.shape == y.shape and np.abs(x - y).max() < 1e-14
    assert np.abs(found - expected).max() < 1e-12 * np.abs(expected).max()
    mesh = read(complete, d, curved=curved)
    for number, name in (
        ((1, "root"), (2, "tip")) if suffix != ".bdf" or d == 3 or not curved else ()
    ):
        mine = str(number) if suffix == ".bdf" else name
        assert len(other.facets(mine)) == len(mesh.facets(name)) > 0
        expected_area = integral(mesh, 1.0, mesh.surface(name))
        assert integral(other, 1.0, other.surface(mine)) == pytest.approx(expected_area, rel=1e-12)


@pytest.mark.parametrize(
    ("kind", "suffix"), [("hexahedron20", ".inp"), ("tetra10", ".bdf"), ("quad8", ".vtu")]
)
def test_midside_nodes_of_each_format_are_at_midsides(
    tmp_path: Path, kind: str, suffix: str
) -> None:
    own = write_msh(tmp_path / "own.msh", kind, kind in ("quad8", "hexahedron20"), straight=True)
    mesh = read(convert(own, tmp_path / f"other{suffix}", kind), CELLS[kind])
    # none that the cells were made straight
    assert not [text for text in mesh.warnings if "do not bend" not in text]
    assert integral(mesh, 1.0) == pytest.approx(1.0)
    if suffix != ".bdf":
        assert integral(mesh, 1.0, mesh.surface("root")) == pytest.approx(1.0)


def cube(path: Path, kind: str = "hexahedron", **more: Any) -> Path:
    """A cube of two hexahedra [0, 2] x [0, 1]², or two squares."""
    x, y, z = (
        a.ravel() for a in np.meshgrid([0.0, 1.0, 2.0], [0.0, 1.0], [0.0, 1.0], indexing="ij")
    )
    points = np.column_stack([x, y, z])
    cells = [[0, 4, 6, 2, 1, 5, 7, 3], [4, 8, 10, 6, 5, 9, 11, 7]]
    sides = {"root": [[0, 1, 3, 2]], "tip": [[8, 9, 11, 10]]}
    blocks = [("hexahedron", cells), ("quad", sides["root"]), ("quad", sides["tip"])]
    meshio.Mesh(points, blocks if kind == "both" else blocks[:1], **more).write(path)
    return path


def test_abaqus_element_sets_become_groups(tmp_path: Path) -> None:
    sets = {"root": [[], [0], []], "ends": [[], [0], [0]], "second": [[1], [], []]}
    cells = {name: [np.array(part, dtype=int) for part in parts] for name, parts in sets.items()}
    mesh = read(cube(tmp_path / "two.inp", "both", cell_sets=cells))
    assert group_names(mesh) == {"solid", "root", "ends", "second"}
    assert [len(mesh.facets(name)) for name in ("root", "ends")] == [1, 2]
    assert np.isin(mesh.cell_tags.values, mesh.cell_groups["second"]).sum() == 1


def test_abaqus_set_named_at_elements_becomes_group(tmp_path: Path) -> None:
    path = cube(tmp_path / "two.inp", "both")
    first, second, third = path.read_text().split("*ELEMENT, TYPE=")[1:]
    head = path.read_text().split("*ELEMENT")[0]
    named = second.replace("\n", ", elset=root\n", 1)
    path.write_text(
        f"{head}*Element, type={first}*element, Type={named}*ELEMENT, TYPE={third}".replace(
            "CAX4P, ", "cax4p, "
        )
    )
    mesh = read(path)
    assert integral(
        mesh, ufl.SpatialCoordinate(mesh.domain)[0] + 1.0, mesh.surface("root")
    ) == pytest.approx(1.0)


def test_abaqus_set_in_parts_is_joined(tmp_path: Path) -> None:
    path = cube(tmp_path / "two.inp")
    more = (
        "*Nset, nset=root\n1, 2,\n*Nset, nset=tip, generate\n9, 12, 1\n"
        "*NSET,NSET=root , internal\n3, 4\n"
    )
    path.write_text(path.read_text() + more)
    mesh = read(path)
    assert group_names(mesh) == {"solid", "root", "tip"} and mesh.node_groups.keys() == {
        "root",
        "tip",
    }
    assert [len(mesh.facets(name)) for name in ("root", "tip")] == [1, 1]


def test_vtu_fields_become_groups(tmp_path: Path) -> None:
    data = {
        "side": [[0, 0], [1], [2]],
        "root": [[0, 0], [1], [0]],
        "pressure": [[0.0, 0.0], [1.0], [1.0]],
    }
    fields = {name: [np.array(part) for part in parts] for name, parts in data.items()}
    points = {"corner": np.arange(12), "edge": np.isin(np.arange(12), [8, 10]).astype(np.int8)}
    mesh = read(cube(tmp_path / "two.vtu", "both", cell_data=fields, point_data=points))
    assert group_names(mesh) == {"solid", "side:0", "side:1", "side:2", "root"}
    assert list(mesh.facets("side:1")) == list(mesh.facets("root")) != list(mesh.facets("side:2"))
    assert mesh.node_groups.keys() == {"edge", *(f"corner:{k}" for k in range(12))}
    assert [len(entities) for entities in mesh.node_groups["edge"]] == [2, 1]
    assert [len(entities) for entities in mesh.node_groups["corner:3"]] == [1, 0]


def test_node_set_becomes_facet_group_and_node_group(tmp_path: Path) -> None:
    sets = {"root": [0, 1, 2, 3], "corner": [8], "middle": [4, 5, 6, 7], "line": [8, 9, 0]}
    mesh = read(
        cube(
            tmp_path / "two.inp", point_sets={name: np.array(nodes) for name, nodes in sets.items()}
        )
    )
    assert group_names(mesh) == {"solid", "root"}  # the middle is inside
    numbers = {
        name: (len(vertices), len(edges)) for name, (vertices, edges) in mesh.node_groups.items()
    }
    assert numbers == {"root": (4, 4), "corner": (1, 0), "middle": (4, 4), "line": (3, 1)}
    space = fem.functionspace(mesh.domain, ("Lagrange", 2))
    x = space.tabulate_dof_coordinates()
    line = {tuple(point) for point in (x[mesh.nodes("line", space)] + 1).round(9) - 1}
    assert line == {(2, 0, 0), (2, 0, 0.5), (2, 0, 1), (0, 0, 0)}
    assert len(mesh.nodes("root", space)) == 9  # with the middle of the facet
    assert len(mesh.nodes("middle", space)) == 8
    with refusal(ErrorKind.PLACE, file="two.inp", names="root"):
        mesh.nodes("rot", space)


def test_facet_without_midside_nodes_is_not_in_group(tmp_path: Path) -> None:
    source = write_msh(tmp_path / "cube.msh", "tetra10", False)
    path = convert(source, tmp_path / "cube.inp", "tetra10")
    text = path.read_text()
    corners = set(
        text.partition("*NSET, NSET=root\n")[2].partition("*NSET")[0].replace("\n", "").split(",")
    )
    cells = [line.split(",") for line in text.partition("*ELEMENT")[2].splitlines()[1:]]
    first = next(cell[1:4] for cell in cells if corners >= set(cell[1:4]))
    path.write_text(f"{text}*NSET, NSET=three\n{', '.join(first)}\n")
    mesh = read(path)
    assert "three" in mesh.node_groups and "three" not in mesh.facet_groups


INVERTED = "2,5,11,9,7,6,10,12,8"  # the second cell with two nodes exchanged


@pytest.mark.parametrize(
    ("old", "new", "names"),
    [
        ("C3D8", "C3D99", "C3D99"),
        ("2,5,9,", "2,5,99,", "99"),
        ("\n1, 0.0000000000000000e+00", "\n1, nan", "coordinate"),
        ("2,5,9,11,7,6,10,12,8", INVERTED, "1 cell "),
    ],
)
def test_damaged_abaqus_file_is_refused(tmp_path: Path, old: str, new: str, names: str) -> None:
    path = cube(tmp_path / "two.inp", point_sets={"root": np.array([0, 1, 2, 3])})
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new))
    kind = ErrorKind.MESH if new == INVERTED else ErrorKind.FORMAT
    with refusal(kind, file="two.inp", names=names):
        read(path)


@pytest.mark.parametrize(
    ("old", "new", "names"),
    [
        ("ENDDATA", "", "ENDDATA"),
        ("GRID*   2" + 16 * " ", "GRID*   2" + 15 * " " + "7", "coordinate system"),
    ],
)
def test_damaged_nastran_file_is_refused(tmp_path: Path, old: str, new: str, names: str) -> None:
    path = cube(tmp_path / "two.bdf")
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new))
    with refusal(ErrorKind.FORMAT, file="two.bdf", names=names):
        read(path)


def test_nastran_without_begin_bulk_is_read_and_empty_file_is_refused(tmp_path: Path) -> None:
    path = cube(tmp_path / "two.bdf")
    path.write_text(path.read_text().replace("BEGIN BULK\n", ""))
    assert integral(read(path), 1.0) == pytest.approx(2.0)
    path.write_text("BEGIN BULK\nENDDATA\n")
    with refusal(ErrorKind.FORMAT, file="two.bdf", names="no cells"):
        read(path)


def test_contact_on_a_node_set_that_is_an_element_set_too_takes_areas(tmp_path: Path) -> None:
    path = cube(tmp_path / "two.inp", point_sets={"root": np.arange(4), "tip": np.arange(8, 12)})
    path.write_text(path.read_text() + "*ELSET, ELSET=tip\n2\n*ELSET, ELSET=root\n1\n")
    contact = touching(
        at="nodes", normal=[1, 0, 0], normal_stiffness=1e6, tangential_stiffness=1e6, friction=0.3
    )
    made = table(path, {"group": "root"}, {"group": "tip"}) | {"contacts": [contact]}
    solid = solid_of(parse_scene(made, "s.toml", tmp_path), read(path))
    assert solid.points.tributary_area.sum() == pytest.approx(1.0, rel=1e-12)
    assert len(solid.mesh.cells("tip")) == 1 and len(solid.mesh.facets("tip")) == 1
    with refusal(ErrorKind.PLACE, file="two.inp", names="root, solid, tip"):
        solid.mesh.cells("rot")


@pytest.mark.slow
@pytest.mark.parametrize(("suffix", "keep"), [(".inp", 0.0), (".vtu", 0.5), (".step", 0.5)])
def test_truncated_file_is_refused(tmp_path: Path, suffix: str, keep: float) -> None:
    path = tmp_path / f"short{suffix}"
    if suffix == ".step":
        write_step(path)
    else:
        cube(path)
    data = path.read_bytes()
    path.write_bytes(data[: int(keep * len(data))])
    with pytest.raises(SceneError, match=rf"short\{suffix}") as error:
        read(path, size=1.0 if suffix == ".step" else None)
    assert "\n" not in str(error.value)


def test_unsupported_cells_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "prism.vtu"
    points = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]]
    meshio.Mesh(points, [("VTK_LAGRANGE_TETRAHEDRON", [[0, 1, 2, 3]])]).write(path)
    with refusal(ErrorKind.FORMAT, file="prism.vtu", names="VTK_LAGRANGE_TETRAHEDRON"):
        read(path)


WEDGE = """# vtk DataFile Version 3.0
one quadratic wedge
ASCII
DATASET UNSTRUCTURED_GRID
POINTS 15 double
0 0 0 1 0 0 0 1 0 0 0 1 1 0 1 0 1 1
0.5 0 0 0.5 0.5 0 0 0.5 0
0.5 0 1 0.5 0.5 1 0 0.5 1
0 0 0.5 1 0 0.5 0 1 0.5
CELLS 1 16
15 0 1 2 3 4 5 6 7 8 9 10 11 12 13 14
CELL_TYPES 1
26
"""


def test_quadratic_wedge_is_read(tmp_path: Path) -> None:
    (tmp_path / "wedge.vtk").write_text(WEDGE)
    mesh = read(tmp_path / "wedge.vtk")
    assert integral(mesh, 1.0) == pytest.approx(0.5) and "3 tetrahedra" in mesh.warnings[0]


FIELDS = {
    ".xdmf": "part",
    ".med": "cell_tags",
    ".mesh": "medit:ref",
    ".vol": "netgen:index",
    ".su2": "su2:tag",
    ".avs": "avsucd:material",
}
"""The integer field of groups in each format that only meshio reads."""


@pytest.mark.parametrize("suffix", FIELDS)
def test_fields_of_other_formats_become_groups(suffix: str, tmp_path: Path) -> None:
    corners = np.array(np.meshgrid([0, 1], [0, 1], [0, 1], indexing="ij")).reshape(3, -1).T
    cells = [("hexahedron", [[0, 4, 6, 2, 1, 5, 7, 3]]), ("quad", [[0, 1, 3, 2]])]
    path, field = tmp_path / f"cube{suffix}", FIELDS[suffix]
    tags = [-1, -2] if suffix == ".med" else [1, 7]
    cube = meshio.Mesh(corners.astype(float), cells, cell_data={field: [[tag] for tag in tags]})
    cube.cell_data[field] = [np.array(values) for values in cube.cell_data[field]]
    cube.cell_tags = {-1: ["inner"], -2: ["x0"]}
    cube.write(path)
    mesh = read(path)
    name = "x0" if suffix == ".med" else f"{field}:7"
    assert integral(mesh, 1.0) == pytest.approx(1.0)
    assert integral(mesh, 1.0, mesh.surface(name)) == pytest.approx(1.0)


def test_file_of_paraview_with_texts_and_flags_is_read(tmp_path: Path) -> None:
    """meshio reads neither the texts nor the raw arrays of these files."""
    pyvista = pytest.importorskip("pyvista")
    corners = np.array(np.meshgrid([0, 1], [0, 1], [0, 1], indexing="ij")).reshape(3, -1).T
    cells, points = np.array([[0, 4, 6, 2, 1, 5, 7, 3]]), corners.astype(float)
    held = (points[:, 0] < 0.5).astype(np.int8)
    written = Grid(points, cells, int(pyvista.CellType.HEXAHEDRON))
    write_vtu(tmp_path / "own.vtu", written, Attached({"held": held}, notes={"unit": "in m"}))
    grid = pyvista.UnstructuredGrid({pyvista.CellType.HEXAHEDRON: cells}, points)
    grid.point_data["held"], grid.field_data["unit"] = held, ["in m"]
    grid.cell_data["flag"] = np.array([True])
    grid.save(tmp_path / "theirs.vtu")
    pyvista.MultiBlock([grid.extract_surface(algorithm=None), grid]).save(tmp_path / "both.vtm")
    for name in ("own.vtu", "theirs.vtu", "both.vtm"):
        mesh = read(tmp_path / name)
        assert integral(mesh, 1.0, mesh.surface("held")) == pytest.approx(1.0)


def test_missing_package_of_a_format_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "netCDF4", None)
    (tmp_path / "part.e").write_text("CDF")
    with refusal(ErrorKind.DEPENDENCY, file="part.e", names="netCDF4"):
        read(tmp_path / "part.e")


def test_doubled_nodes_leave_pieces(tmp_path: Path) -> None:
    x = np.array(
        [[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]]
    )
    path = tmp_path / "apart.vtu"
    marks = np.arange(16) < 8
    points, cells = np.concatenate([x, x + np.eye(3)[0]]), [list(range(8)), list(range(8, 16))]
    meshio.Mesh(points, [("hexahedron", cells)], point_data={"first": marks.astype(int)}).write(
        path
    )
    mesh = read(path)
    assert mesh.warnings == ()
    with refusal(ErrorKind.SUPPORT, "supports", names="1 connected piece"):
        solid_of(scene(path, {"group": "first"}, {"nearest": [2.0, 1.0, 1.0]}), mesh)


def test_supported_pieces_that_share_no_node_are_named(tmp_path: Path) -> None:
    corners = np.array(np.meshgrid([0, 1], [0, 1], [0, 1], indexing="ij")).reshape(3, -1).T
    order = [0, 4, 6, 2, 1, 5, 7, 3]  # of a hexahedron
    points = np.concatenate([corners[order], corners[order] + [0.0, 0.0, 1.01]]).astype(float)
    field = {"held": np.isclose(points[:, 0], 0.0).astype(int)}
    cells = [("hexahedron", [list(range(8)), list(range(8, 16))])]
    path = tmp_path / "apart.vtu"
    meshio.Mesh(points, cells, point_data=field).write(path)
    for warnings in (
        solid_of(scene(path, {"group": "held"}, {"nearest": [1.0, 1.0, 1.0]}), read(path)).warnings,
        inspect(path).warnings,
    ):
        (warning,) = warnings
        assert "2 pieces that share no node" in warning
        assert "(0 to 1, 0 to 1, 0 to 1), (0 to 1, 0 to 1, 1.01 to 2.01) m" in warning


def test_damaged_step_file_is_named_as_the_user_named_it(tmp_path: Path) -> None:
    path = tmp_path / "part.step"
    path.write_text("ISO-10303-21;\nHEADER;\nENDSEC;\nDATA;\n#1 = NONSENSE((;\n")
    with pytest.raises(SceneError) as caught:
        read(path, size=0.1)
    assert str(path) in str(caught.value) and "fenicsrom-" not in str(caught.value)


def test_scale_multiplies_coordinates(tmp_path: Path) -> None:
    path = cube(tmp_path / "two.inp", point_sets={"root": np.array([0, 1, 2, 3])})
    mesh = read(path, scale=1e-3)
    assert integral(mesh, 1.0) == pytest.approx(2e-9)
    assert integral(mesh, 1.0, mesh.surface("root")) == pytest.approx(1e-6)


def write_step(path: Path) -> Path:
    """A cylinder of 20 mm by 100 mm, along x."""
    return step_file(path, lambda occ: occ.addCylinder(0, 0, 0, 100, 0, 0, 10))


@pytest.mark.slow
def test_step_file_is_meshed(tmp_path: Path) -> None:
    path = write_step(tmp_path / "rod.step").rename(tmp_path / "rod.STP")
    coarse, fine = (read(path, size=size, curved=True) for size in (0.01, 0.005))
    volume = np.pi * 0.01**2 * 0.1
    assert integral(coarse, 1.0) == pytest.approx(volume, rel=2e-2)
    assert integral(fine, 1.0) == pytest.approx(volume, rel=2e-3)
    numbers = [mesh.domain.topology.index_map(3).size_global for mesh in (coarse, fine)]
    assert 2 * numbers[0] < numbers[1] < 16 * numbers[0]
    assert group_names(coarse) == {"solid", "1", "2", "3"}
    root = Region(plane=Plane(point=(0.0, 0.0, 0.0), normal=(1.0, 0.0, 0.0)))
    tip = Region(box=((0.1, -0.01, -0.01), (0.1, 0.01, 0.01)))
    for region, x in ((root, 0.0), (tip, 0.1)):
        place = ufl.SpatialCoordinate(fine.domain)[0]
        area = integral(fine, 1.0, fine.surface(region))
        assert area == pytest.approx(np.pi * 0.01**2, rel=2e-3)
        assert integral(fine, place, fine.surface(region)) == pytest.approx(x * area, abs=1e-12)
        assert any(set(fine.facets(region)) == set(fine.facets(name)) for name in "123")


def test_pick_finds_facets_of_the_boundary_only(tmp_path: Path) -> None:
    mesh = read(cube(tmp_path / "two.inp"))
    plane = {"point": (0.0, 0.0, 0.01), "normal": (0.0, 0.0, 1.0)}
    near = Region(plane=Plane(**plane, tolerance=0.02))
    assert integral(mesh, 1.0, mesh.surface(near)) == pytest.approx(2.0)
    with refusal(ErrorKind.PLACE, file="two.inp", names="(0, 0, 0) to (2, 1, 1)"):
        mesh.facets(Region(plane=Plane(**plane)))
    assert (
        len(mesh.facets(Region(box=((0.0, 0.0, 0.0), (1.0, 1.0, 1.0))))) == 5
    )  # not the one inside
    assert len(mesh.facets(Region(box=((-1.0, -1.0, -1.0), (3.0, 2.0, 2.0))))) == 10
    with refusal(ErrorKind.PLACE, file="two.inp", names="box = "):
        mesh.nodes(
            Region(box=((0.1, 0.0, 0.0), (1.9, 1.0, 1.0))),
            fem.functionspace(mesh.domain, ("Lagrange", 1)),
        )


def table(
    path: Path, support: dict[str, Any], place: dict[str, Any], **geometry: Any
) -> dict[str, Any]:
    """A scene with one support and one load."""
    return {
        "geometry": {"mesh": str(path), "dimension": 3} | geometry,
        "material": {"young": 1e7, "poisson": 0.3, "density": 1e3},
        "supports": [support],
        "loads": [{"direction": [0, 0, 1], "force": 1.0, "frequency": 1.0} | place],
        "basis": {"modes": 2},
    }


def scene(path: Path, support: dict[str, Any], place: dict[str, Any], **geometry: Any) -> Scene:
    """The checked scene of `table`."""
    return parse_scene(table(path, support, place, **geometry), "s.toml", path.parent)


UNIT_BOX = [[0, 0, 0], [1, 1, 1]]


@pytest.mark.parametrize(
    ("support", "kind", "key"),
    [
        ({}, ErrorKind.MISSING, "group"),
        ({"box": [[0, 0], [1, 1]]}, ErrorKind.CONFLICT, "box[0]"),
        ({"plane": {"point": [0, 0, 0]}}, ErrorKind.MISSING, "plane.normal"),
        ({"group": "a", "box": UNIT_BOX}, ErrorKind.CONFLICT, "box"),
    ],
)
def test_wrong_support_is_refused(
    tmp_path: Path, support: dict[str, Any], kind: ErrorKind, key: str
) -> None:
    with refusal(kind, f"supports[0].{key}", "s.toml"):
        scene(tmp_path / "a.inp", support, {"group": "tip"})


@pytest.mark.parametrize(
    ("place", "kind", "key"),
    [
        ({}, ErrorKind.MISSING, "group"),
        ({"nearest": [0, 0, 0], "node": [0, 0, 0]}, ErrorKind.CONFLICT, "nearest"),
    ],
)
def test_wrong_place_is_refused(
    tmp_path: Path, place: dict[str, Any], kind: ErrorKind, key: str
) -> None:
    with refusal(kind, f"loads[0].{key}", "s.toml"):
        scene(tmp_path / "a.inp", {"group": "root"}, place)


@pytest.mark.parametrize(
    ("geometry", "kind", "key"),
    [
        ({"size": 1.0}, ErrorKind.CONFLICT, "size"),
        ({"mesh": "s.STEP"}, ErrorKind.MISSING, "size"),
        ({"mesh": "s.stp", "size": 1.0, "scale": 2.0}, ErrorKind.CONFLICT, "scale"),
    ],
)
def test_size_and_scale_that_do_not_fit_the_file_are_refused(
    tmp_path: Path, geometry: dict[str, Any], kind: ErrorKind, key: str
) -> None:
    with refusal(kind, f"geometry.{key}", "s.toml"):
        scene(tmp_path / "a.inp", {"group": "a"}, {"group": "b"}, **geometry)


def test_scene_with_picks_survives_round_trip(tmp_path: Path) -> None:
    from fenicsrom.scene import scene_table

    path = cube(tmp_path / "two.inp")
    plane = {"point": [0, 0, 0], "normal": [2, 0, 0], "tolerance": 1e-3}
    supports = [{"box": [[2, 1, 1], [0, 1, 0]]}, {"plane": plane}]
    places = [{"nearest": [2, 0, 0]}, {"box": [[2, 0, 0], [2, 1, 1]], "at": "centre"}]
    for support, place in zip(supports, places, strict=True):
        made = scene(path, support, place, scale=0.5)
        assert parse_scene(scene_table(made), "s.toml", path.parent) == made
    assert scene(path, supports[0], {"group": "tip"}).supports[0].box == (
        (0.0, 1.0, 0.0),
        (2.0, 1.0, 1.0),
    )


def clamped(solid: Any) -> set[tuple[float, ...]]:
    """Coordinates of the clamped nodes."""
    x = solid.space.tabulate_dof_coordinates()
    return {tuple(point) for point in x[np.unique(solid.clamped // 3)]}


@pytest.mark.slow
def test_places_and_supports_by_pick_match_those_by_group(tmp_path: Path) -> None:
    sets = {"root": [0, 1, 2, 3], "line": [8, 9], "points": [8, 11], "l": [0, 1]}
    path = cube(
        tmp_path / "two.inp", point_sets={name: np.array(nodes) for name, nodes in sets.items()}
    )
    mesh = read(path)
    tip = {"plane": {"point": [2, 0, 0], "normal": [1, 0, 0]}}
    root = {"box": [[0, 0, 0], [0, 1, 1]]}
    by_name, by_box = (
        solid_of(scene(path, support, tip), mesh) for support in ({"group": "root"}, root)
    )
    assert clamped(by_name) == clamped(by_box) and len(clamped(by_box)) == 9
    x = by_box.space.tabulate_dof_coordinates()
    assert by_box.load_vectors[2::3, 0] @ x[:, 0] == pytest.approx(2.0)
    assert by_box.load_vectors[2::3, 0] @ (x[:, 1] ** 2) == pytest.approx(1 / 3)
    for place, moment in (
        (dict(group="line"), 1 / 3),
        (dict(group="points"), 1 / 2),
        (dict(nearest=[2.2, 1, 1]), 1.0),
    ):
        solid = solid_of(scene(path, root, place), mesh)
        weights = solid.load_vectors[2::3, 0]
        assert weights.sum() == pytest.approx(1.0)
        assert weights @ x[:, 2] ** 2 == pytest.approx(moment)
        assert weights @ x[:, 0] == pytest.approx(2.0)
        told = [warning for warning in solid.warnings if "nearest" in warning]
        ending = "nearest = [2.2, 1.0, 1.0]: the nearest node is [2.0, 1.0, 1.0], 0.2 m away"
        assert told == ([f"s.toml: loads[0].{ending}"] if "nearest" in place else [])
    with refusal(ErrorKind.PLACE, "loads[0].node", names="[2.0"):
        solid_of(scene(path, root, {"node": [2.2, 1, 1]}), mesh)
    with refusal(ErrorKind.PLACE, "loads[0]", names="clamped"):
        solid_of(scene(path, root, {"nearest": [-1, 0, 0]}), mesh)
    for name in ("l", "points"):
        with refusal(ErrorKind.SUPPORT, "supports", names="1 rotation free"):
            solid_of(scene(path, {"group": name}, tip), mesh)


TWO_RANKS = """
import json, sys
from pathlib import Path
import numpy as np
from dolfinx import fem
from mpi4py import MPI
from fenicsrom.errors import SceneError
from fenicsrom.fem.mesh.mesh import build_mesh
from fenicsrom.reduction.modes import component_modes
from fenicsrom.scene import Basis, parse_scene
from fenicsrom.fem.solid.solid import solid_of
comm = MPI.COMM_WORLD
found = []
for table in json.loads(Path(sys.argv[1]).read_text()):
    scene = parse_scene(table, "s.toml", Path(sys.argv[1]).parent)
    mesh = build_mesh(scene.geometry, comm)
    solid = solid_of(scene, mesh)
    modes = component_modes(solid, Basis(method="rubin", modes=2))
    node = sorted((name, comm.allreduce(int((mesh.nodes(name, solid.space)
                   < solid.local // 3).sum()))) for name in mesh.node_groups)
    found.append([solid.size, modes.frequencies_hz.tolist(), solid.probe_position.tolist(), node,
                  solid.free, sorted(mesh.warnings)])
    try:
        mesh.nodes("nothing", solid.space)
    except SceneError as error:
        assert len(set(comm.allgather(str(error)))) == 1
for wrong in sys.argv[2:]:
    table = json.loads(Path(sys.argv[1]).read_text())[0]
    table["geometry"]["mesh"] = wrong
    try:
        build_mesh(parse_scene(table, "s.toml", Path(wrong).parent).geometry, comm)
    except SceneError as error:
        said = comm.allgather(str(error))
        assert len(set(said)) == 1 and "no cells" in said[0], said
    else:
        raise AssertionError(wrong)
if comm.rank == 0:
    print("FOUND", json.dumps(found))
"""


@pytest.mark.slow
@needs_mpirun
def test_two_ranks_give_the_same_imported_mesh(tmp_path: Path) -> None:
    import json

    source = write_msh(tmp_path / "source.msh", "hexahedron20", True)
    inp = convert(source, tmp_path / "cube.inp", "hexahedron20")
    step = write_step(tmp_path / "rod.step")
    (tmp_path / "cut.inp").write_text(inp.read_text()[:5000])
    tip = {"plane": {"point": [0.1, 0, 0], "normal": [1, 0, 0]}}
    box = {"box": [[0, -1, -1], [0, 1, 1]]}
    parameters = {"elements_along": 2, "elements_across": 8, "load_at": 0.5}
    blade = {"cells": "structured", "curved": True, "parameters": parameters}
    tables = [
        table(inp, {"group": "root"}, {"group": "tip", "at": "centre"}, curved=True),
        table(step, box, tip, size=0.02, curved=True),
        table(shared_meshes() / "blade.geo", box, {"group": "tip_nodes"}, **blade),
    ]
    (tmp_path / "scenes.json").write_text(json.dumps(tables))
    found = []
    for ranks in (1, 2):
        done = on_ranks(
            ranks, "-c", TWO_RANKS, str(tmp_path / "scenes.json"), str(tmp_path / "cut.inp")
        )
        found.append(json.loads(done.stdout.partition("FOUND")[2]))
    for one, two in zip(*found, strict=True):
        assert one[0] == two[0] and one[3:] == two[3:]
        assert np.allclose(one[1], two[1], rtol=1e-8) and min(one[1]) > 0
        assert np.allclose(one[2], two[2], atol=1e-12)
    assert dict(map(tuple, found[0][2][3])) == {"tip_nodes": 17}  # shared by the ranks
