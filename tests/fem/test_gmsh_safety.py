"""A data file never runs as a script of gmsh; formats that gmsh reads."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("gmsh")
from support import gmsh_session, refusal

from fenicsrom.errors import ErrorKind
from fenicsrom.fem.mesh.gmsh_files import load_file, open_gmsh
from fenicsrom.fem.mesh.inspection import inspect
from fenicsrom.scene import Geometry


def write_box(path: Path, incomplete: bool = False) -> Path:
    """A unit cube of eight hexahedra with the groups body and root; quadratic if incomplete."""
    with gmsh_session() as gmsh:
        gmsh.model.add("box")
        gmsh.model.occ.addBox(0, 0, 0, 1, 1, 1)
        gmsh.model.occ.synchronize()
        gmsh.model.mesh.setTransfiniteAutomatic()
        for curve in range(1, 13):
            gmsh.model.mesh.setTransfiniteCurve(curve, 3)
        gmsh.model.addPhysicalGroup(3, [1], name="body")
        gmsh.model.addPhysicalGroup(2, [1], name="root")
        gmsh.model.mesh.generate(3)
        if incomplete:
            gmsh.option.setNumber("Mesh.SecondOrderIncomplete", 1)
            gmsh.model.mesh.setOrder(2)
        gmsh.write(str(path))
    return path


@pytest.mark.parametrize(
    ("suffix", "before"), [(".msh", ""), (".unv", ""), (".step", ""), (".msh", "// $MeshFormat\n")]
)
def test_script_with_the_suffix_of_data_does_not_run(
    tmp_path: Path, suffix: str, before: str
) -> None:
    ran, path = tmp_path / "ran", tmp_path / f"a{suffix}"
    path.write_text(f'{before}SystemCall "touch {ran}";\n')
    with refusal(ErrorKind.FORMAT, file=path.name):
        inspect(path, size=1.0)
    assert not ran.exists()


@pytest.mark.slow
def test_script_beside_a_mesh_does_not_run(tmp_path: Path) -> None:
    ran, path = tmp_path / "ran", write_box(tmp_path / "a.msh")
    for name in (f"{path}.opt", tmp_path / "a.opt", tmp_path / "a.geo"):
        Path(name).write_text(f'SystemCall "touch {ran}";\n')
    found = inspect(path)
    assert found.volume == pytest.approx(1.0) and not ran.exists()


@pytest.mark.slow
def test_groups_of_a_format_that_gmsh_reads_are_kept(tmp_path: Path) -> None:
    found = inspect(write_box(tmp_path / "a.unv"))
    groups = {(group.name, group.kind): group for group in found.groups}
    assert groups["body", "cells"].size == pytest.approx(1.0)
    assert groups["root", "facets"].size == pytest.approx(1.0)
    assert groups["root", "facets"].number == 4


@pytest.mark.slow
def test_hexahedra_of_20_nodes_are_completed(tmp_path: Path) -> None:
    path = write_box(tmp_path / "a.msh", incomplete=True)
    assert inspect(path).cells == {"hexahedra of 20 nodes": 8}
    with open_gmsh() as opened:
        load_file(opened, Geometry(mesh=path, dimension=3, curved=True))
        kinds = {int(kind) for kind in opened.model.mesh.getElementTypes()}
        names = {opened.model.getPhysicalName(*group) for group in opened.model.getPhysicalGroups()}
        numbers, points, _ = opened.model.mesh.getNodes()
        local = opened.model.mesh.getElementProperties(12)[4]
        _, weights, _ = opened.model.mesh.getBasisFunctions(5, local, "Lagrange")
        rows = opened.model.mesh.getElementsByType(12)[1].reshape(-1, 27)
    assert {10, 12} <= kinds and not {16, 17} & kinds and names == {"body", "root"}
    x = points.reshape(-1, 3)[np.argsort(numbers)][np.searchsorted(np.sort(numbers), rows)]
    assert len(numbers) == 125
    assert np.allclose(np.einsum("pn,cni->cpi", weights.reshape(27, 8), x[:, :8]), x)


def test_node_number_given_twice_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.msh"
    nodes = "1 0 0 0\n2 1 0 0\n3 1 1 0\n4 0 1 0\n4 0 2 0\n"
    path.write_text(
        f"$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n5\n{nodes}$EndNodes\n"
        "$Elements\n1\n1 3 2 1 1 1 2 3 4\n$EndElements\n"
    )
    with refusal(ErrorKind.FORMAT, file="a.msh", names="node 4"):
        inspect(path)
