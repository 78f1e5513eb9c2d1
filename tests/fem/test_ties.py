"""Ties: two regions that move as one, although their meshes do not match."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("meshio")
pytest.importorskip("dolfinx")
from mpi4py import MPI

import fenicsrom as fr
from fenicsrom.assess.rotation.disk_modes import directions, wave_modes
from fenicsrom.errors import ErrorKind
from fenicsrom.exchange.deck import scene_deck
from fenicsrom.fem.mesh.mesh import build_mesh
from fenicsrom.fem.solid.solid import solid_of
from fenicsrom.fem.solid.wave import wave
from fenicsrom.post.setup.setup import gathered_marks
from tests.boxes import blocks, rings, stacked
from tests.support import (
    assert_force_of_energy,
    assert_polynomial_is_exact,
    assert_tangent_of_force,
    refusal,
)

STEEL = {"young": 210e9, "poisson": 0.3, "density": 7800.0}
FAR = {"group": "0 low x", "against": "1 low x", "reach": 0.01}
END = {"direction": [0.0, 1.0], "force": 1.0, "frequency": 1.0}


def scene_of(mesh: Path, d: int = 2, degree: int = 2, **tables: Any) -> Any:
    """The scene of a steel body of 1 m in the third direction."""
    thick = {"thickness": 1.0} if d == 2 else {}
    table: dict[str, Any] = {
        "geometrically_nonlinear": False,
        "geometry": {"mesh": str(mesh), "dimension": d, "degree": degree, **thick},
        "material": STEEL,
    }
    return fr.parse_scene(table | tables, "ties.toml", None, unloaded=True)


def solid(scene: Any) -> Any:
    return solid_of(scene, build_mesh(scene.geometry, MPI.COMM_SELF))


def hertz(body: Any, count: int) -> Any:
    return np.sqrt(body.eigenmodes(body.factor, count)[0]) / (2.0 * np.pi)


@pytest.mark.slow
@pytest.mark.parametrize("first", ["1 low y", "0 high y"], ids=["fine", "coarse"])
@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("kind", ["quadrilaterals", "hexahedra", "tetrahedra"])
def test_constant_pressure_passes_through_a_tie(
    tmp_path: Path, kind: str, degree: int, first: str
) -> None:
    """Reference: constant pressure through a tie | closed form | 1 MPa | 0.03 to 0.1 %; 0.23 % on
    the coarse side | 0.1 %; 0.3 %
    """
    d, tetrahedra = 2 if kind == "quadrilaterals" else 3, kind == "tetrahedra"
    upper, lower = (7, 5) if d == 2 else (4, 3)
    mesh = stacked(tmp_path / "blocks.vtu", d, upper, lower, tetrahedra=tetrahedra)
    planes = [("x", "0 low x"), ("x", "1 low x"), ("y", "0 low y")]
    planes += [("z", "0 low z"), ("z", "1 low z")] if d == 3 else []
    second = {"1 low y": "0 high y", "0 high y": "1 low y"}[first]
    scene = scene_of(
        mesh,
        d,
        degree,
        ties=[{"group": first, "against": second}],
        supports=[{"group": name, "components": [axis]} for axis, name in planes],
        loads=[{"group": "1 high y", "pressure": 1e6}],
    )
    body = solid(scene)
    strain = -1e6 / 210e9 * np.array([-0.3, 1.0, -0.3])[:d]
    expected = body.space.tabulate_dof_coordinates()[:, :d] * strain
    found = body.equilibrium.reshape(-1, d)
    limit = 1e-3 if first == "1 low y" else 3e-3
    assert np.abs(found - expected).max() < limit * np.abs(expected).max()


def bar(path: Path, tied: bool, cells: tuple[int, int] = (4, 3), **tables: Any) -> Any:
    """The scene of a clamped bar of 0.2 x 0.05 m, of two tied blocks or of one."""
    parts = [((0.0, 0.0), (0.2, 0.05), (40, cells[0]))]
    if tied:
        halves = zip((0.0, 0.1), (0.1, 0.2), cells, strict=True)
        parts = [((low, 0.0), (high, 0.05), (20, count)) for low, high, count in halves]
    ties = [{"group": "0 high x", "against": "1 low x"}] if tied else []
    tip = {"group": "1 high x" if tied else "0 high x"}
    return scene_of(
        blocks(path / f"bar{tied}.vtu", *parts),
        supports=[{"group": "0 low x"}],
        **{"ties": ties, "loads": [END | tip], "probe": tip} | tables,
    )


def test_tied_bar_has_the_frequencies_of_the_bar_in_one_piece(tmp_path: Path) -> None:
    """Four cells against three; the two bars of one mesh differ by 2e-4 to 7e-4.

    Reference: bar of two tied blocks, 4 : 3 cells | bar in one piece | 1003.2 to 11717 Hz | 6e-6 to
    8e-5 | 1e-4
    """
    found, whole = (hertz(solid(bar(tmp_path, tied)), 4) for tied in (True, False))
    np.testing.assert_allclose(found, whole, rtol=1e-4)


def test_tied_bar_bends_as_far_as_the_bar_in_one_piece(tmp_path: Path) -> None:
    """By half of its length; the tie gives way, but hardly."""
    tips = []
    for tied in (True, False):
        body = solid(bar(tmp_path, tied, geometrically_nonlinear=True))
        u = body.static(1e8 * body.load_vectors[:, 0])
        tips.append(body.probe_rows @ u)
        if tied:
            x = body.space.tabulate_dof_coordinates()[:, :2].ravel()
            force = body.couplings @ (x + u)
            jump = u @ force / (u @ body.internal_force(u))
            assert 2e-5 < jump < 6e-5
    assert 0.08 < tips[1][1] < 0.12
    np.testing.assert_allclose(*tips, rtol=5e-5)


def test_tie_is_part_of_the_tangent_the_energy_and_the_polynomial(tmp_path: Path) -> None:
    body = solid(bar(tmp_path, True, (2, 1), geometrically_nonlinear=True))
    assert_force_of_energy(body)
    assert_tangent_of_force(body)
    assert_polynomial_is_exact(body)


def tied_rings(path: Path, angle: float = 2.0 * np.pi, **tables: Any) -> Any:
    """The solid of two tied rings, whose facets are chords of one circle."""
    turns = angle / (2.0 * np.pi)
    parts = (0.1, 0.2, 2, round(36 * turns)), (0.2, 0.3, 2, round(54 * turns))
    mesh = rings(path / f"rings{round(36 * turns)}.vtu", *parts, angle=angle)
    more = {"supports": [{"group": "0 low"}], "probe": {"group": "1 high"}}
    return solid(scene_of(mesh, ties=[{"group": "1 low", "against": "0 high"}], **more, **tables))


def test_tie_lets_both_bodies_turn_together_through_the_gaps_of_chords(tmp_path: Path) -> None:
    body = tied_rings(tmp_path)
    x = body.space.tabulate_dof_coordinates()[:, :2]
    turn = np.array([[np.cos(0.3), -np.sin(0.3)], [np.sin(0.3), np.cos(0.3)]])
    found = body.couplings @ (x @ turn.T - x).ravel()
    assert np.abs(found).max() < 1e-14 * abs(body.couplings).max()
    assert "gaps 0.000" in body.pairs[0]


def test_tied_sector_has_the_frequencies_of_the_tied_disk(tmp_path: Path) -> None:
    """The averages around nodes of the cut faces lack half of their neighbours."""
    whole = hertz(tied_rings(tmp_path), 9)
    cyclic = {"sectors": 6, "left": "left", "right": "right"}
    sector, found = tied_rings(tmp_path, np.pi / 3.0, cyclic=cyclic), []
    for h in range(4):
        with wave(sector, h) as one:
            squares = wave_modes(one, 4 * directions(sector, h))[0]
            found += [*squares.repeat(1 if h in (0, 3) else 2)]
    np.testing.assert_allclose(np.sqrt(np.sort(found))[:9] / (2.0 * np.pi), whole, rtol=3e-7)


def test_picture_of_the_setup_shows_a_tie(tmp_path: Path) -> None:
    scene = bar(tmp_path, True)
    body = solid(scene)
    gathered = gathered_marks(body, scene, {})
    assert gathered is not None
    (mark,) = (mark for mark in gathered[2] if mark.label.startswith("tie"))
    np.testing.assert_allclose(mark.places[:, 0], 0.1)
    assert not body.warnings  # on pieces that do not feel each other


@pytest.mark.parametrize(
    ("kind", "key", "tables"),
    [
        (ErrorKind.CONFLICT, "ties[0].against", {"ties": [{"group": "a", "against": "a"}]}),
        (ErrorKind.PLACE, "ties[0].against", {"ties": [FAR]}),
        (
            ErrorKind.CONFLICT,
            "ties[0].against",
            {
                "contacts": [
                    {
                        **{"group": "1 low x", "against": "0 high x", "friction": 0.3},
                        **{"normal_stiffness": 1e13, "tangential_stiffness": 1e13},
                    }
                ]
            },
        ),
    ],
    ids=["same group", "far apart", "a contact too"],
)
def test_ties_that_make_no_sense_are_refused(
    tmp_path: Path, kind: ErrorKind, key: str, tables: dict[str, Any]
) -> None:
    with refusal(kind, key):
        solid(bar(tmp_path, True, **tables))


def test_deck_for_calculix_refuses_ties(tmp_path: Path) -> None:
    with refusal(ErrorKind.CONFLICT, "ties"):
        scene_deck(bar(tmp_path, True))
