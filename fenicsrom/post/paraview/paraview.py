"""Names with units, groups, surfaces, and one file for ParaView that joins all files.

The names of arrays end in their unit. Texts on the normalisation and on the material are field
data, which ParaView shows in the Information panel.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.files import atomic_folder, atomic_write
from fenicsrom.online.stress.stress import principal, von_mises
from fenicsrom.post.paraview.vtk import Attached, linear_grid, write_blocks, write_series, write_vtu
from fenicsrom.records import Study
from fenicsrom.scene import Elasticity, GroupMaterial, scene_heading

if TYPE_CHECKING:
    from fenicsrom.fem.solid.solid import Solid

INDEX = "results.pvd"
BLOCKS = "results"  # folder of the lists of blocks, one per instant
GROUPS = "groups.vtu"

NORMALISATION = {
    "normal_modes": (
        "The modes have the modal mass 1 kg: the displacement in m is the array times a modal "
        "coordinate in m sqrt(kg), and the stress in Pa is its array times the same coordinate."
    ),
    "static_modes": (
        "rubin: residual displacement under a unit contact force, m/N. craig-bampton: displacement "
        "by a unit contact displacement, m/m."
    ),
    "derivatives": (
        "The derivative AB is the change of vector A along vector B: the unit is that of A times "
        "that of B, per metre."
    ),
    "equilibrium": "The displacement and the stress under the static loads, at speed.",
}


def array_name(study: Study, kind: str, label: str) -> str:
    """Name of the array of a shape, with frequency and unit."""
    if kind == "normal_modes" and study.modes is not None:
        frequency = study.modes.frequencies_hz[int(label.removesuffix("V")) - 1]
        return f"{label}_{frequency:.5g}_Hz_per_sqrt_kg"
    if kind == "static_modes" and study.modes is not None:
        unit = "m_per_N" if study.modes.method == "rubin" else "m_per_m"
        return f"{label}_{unit}"
    return "displacement_m" if kind == "equilibrium" else label


def _constants(material: Elasticity) -> str:
    """The constants of a material in words."""
    young, poisson = (
        ", ".join(f"{value:g}" for value in (given if isinstance(given, tuple) else (given,)))
        for given in (material.young, material.poisson)
    )
    of = f"group {material.group}: " if isinstance(material, GroupMaterial) else ""
    return (
        f"{of}Young's modulus {young} Pa, Poisson's ratio {poisson}, "
        f"density {material.density:g} kg/m^3"
    )


def notes(study: Study, kind: str) -> dict[str, str]:
    """The texts of a file: normalisation and material."""
    scene = study.scene
    found = {
        "title": scene_heading(scene),
        "material": "; ".join(map(_constants, (scene.material, *scene.materials))),
    }
    if kind in NORMALISATION:
        found["normalisation"] = NORMALISATION[kind]
    if study.recovery is not None and kind in ("normal_modes", "equilibrium", "motion"):
        found["stress"] = (
            "Points: extrapolated from the Gauss points and averaged over cells. Cells: mean of "
            "the Gauss points. Components: xx, yy, zz, xy, yz, xz."
        )
    return found


def cell_groups(solid: Solid) -> dict[str, NDArray[np.int8]]:
    """For each group of cells, 1 in its cells on this rank and 0 in all other cells."""
    mesh, cells = solid.mesh, solid.owned_cells()
    return {
        f"group_{name}": np.isin(cells, mesh.cells(name)).astype(np.int8)
        for name in mesh.cell_groups
    }


def stress_fields(study: Study) -> Callable[[Array, str, str], Attached]:
    """Make a function that gives stresses (P, 6) at the Gauss points as arrays of this rank.

    The other arguments of this function are a prefix and a suffix of the names, such as the unit.
    Collective.
    """
    from fenicsrom.fem.body.stress_points import local_part

    assert study.recovery is not None
    table, part = study.recovery.stress, local_part(study.solid)

    def attach(stress: Array, prefix: str, unit: str) -> Attached:
        nodes = part.at_nodes(table, table.at_vertices(stress))
        cells = table.in_cells(stress)[part.cells]

        def named(values: Array) -> dict[str, Any]:
            derived = {"von_mises": von_mises(values), "principal": principal(values)}
            found = {"stress": values} | derived
            return {f"{prefix}{name}_{unit}": a.astype(np.float32) for name, a in found.items()}

        return Attached(named(nodes), named(cells))

    return attach


def write_groups(solid: Solid, folder: Path) -> list[Path]:
    """Write the facets of all facet groups, with 1 in the facets of each group. Collective.

    Raises:
        OSError: the file cannot be written.
    """
    from fenicsrom.fem.base.compat import entity_nodes

    mesh, domain = solid.mesh, solid.mesh.domain
    d = domain.topology.dim
    names = list(mesh.facet_groups)
    owned = domain.topology.index_map(d - 1).size_local
    facets = np.unique(np.concatenate([*(mesh.facets(name) for name in names), np.zeros(0, int)]))
    facets = facets[facets < owned]
    domain.topology.create_connectivity(d - 1, d)
    domain.topology.create_connectivity(d - 1, 0)
    count = domain.topology.connectivity(d - 1, 0).links(0).size
    corners = entity_nodes(domain, d - 1, facets)[:, :count]
    places = domain.geometry.x[corners]
    flags = {f"group_{name}": np.isin(facets, mesh.facets(name)) for name in names}
    every = domain.comm.gather((places, flags))
    if every is None or not names:
        return []
    whole = np.concatenate([part[0] for part in every])
    points, cells = np.unique(whole.reshape(-1, 3), axis=0, return_inverse=True)
    marks = {
        name: np.concatenate([part[1][name] for part in every]).astype(np.int8) for name in flags
    }
    grid = linear_grid(points, cells.reshape(whole.shape[:2]), d - 1)
    with atomic_write(folder / GROUPS) as temporary:
        write_vtu(temporary, grid, Attached(cells=marks))
    return [folder / GROUPS]


def write_index(folder: Path, files: Sequence[Path]) -> list[Path]:
    """Write the `.pvd` file that opens all ParaView files of a run together, block by block.

    Static files are repeated at every instant. On one rank.

    Args:
        folder: the folder of the run.
        files: files of the run; files that ParaView does not read are left out.

    Raises:
        OSError: a file cannot be written.
    """
    static = {path.stem: _pieces(path) for path in files if path.suffix in (".vtu", ".pvtu")}
    series = {path.stem: _instants(path) for path in files if path.suffix == ".pvd"}
    if not static and not series:
        return []
    times = sorted({time for instants in series.values() for time, _ in instants}) or [0.0]
    with atomic_folder(folder / BLOCKS) as temporary:
        entries = []
        for number, time in enumerate(times):
            found = dict(static)
            for name, instants in series.items():
                found[name] = min(instants, key=lambda instant: abs(instant[0] - time))[1]
            blocks = [
                (name if len(pieces) == 1 else f"{name} {k}", f"../{piece.relative_to(folder)}")
                for name, pieces in sorted(found.items())
                for k, piece in enumerate(pieces)
            ]
            file = f"{BLOCKS}_{number:05d}.vtm"
            write_blocks(temporary / file, blocks)
            entries.append((time, f"{BLOCKS}/{file}"))
    with atomic_write(folder / INDEX) as temporary:
        write_series(temporary, entries)
    return [folder / INDEX]


def _pieces(path: Path) -> list[Path]:
    """The files of a grid: those of its ranks, or the file itself."""
    if path.suffix != ".pvtu":
        return [path]
    sources = (piece.get("Source") for piece in ET.parse(path).iter("Piece"))
    return [path.parent / source for source in sources if source]


def _instants(path: Path) -> list[tuple[float, list[Path]]]:
    """The instants (s) of a series, and the files of each."""
    return [
        (float(entry.attrib["timestep"]), _pieces(path.parent / entry.attrib["file"]))
        for entry in ET.parse(path).iter("DataSet")
    ]
