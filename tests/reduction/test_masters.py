"""Interface modes by the block Lanczos method: those of the whole contact flexibility."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from fenicsrom.errors import ErrorKind
from fenicsrom.reduction import modes as masters
from fenicsrom.reduction.modes import master_directions

pytest.importorskip("dolfinx")

from support import beam_scene, make_solid, refusal


@pytest.fixture(scope="module")
def edged() -> Any:
    """A short beam with contact points at the nodes of its tip."""
    touch = {
        "group": "tip",
        "at": "nodes",
        "normal": [1.0, 0.0, 0.0],
        "preload": 1e3,
        "friction": 0.3,
        "normal_stiffness": 1e10,
        "tangential_stiffness": 1e10,
    }
    return make_solid(
        beam_scene(
            3,
            ("geometry.parameters.length=0.2", "geometry.parameters.elements_along=2"),
            contacts=[touch],
        )
    )


@pytest.mark.parametrize("count", [3, 7])
def test_interface_modes_by_lanczos_are_those_of_the_flexibility(
    edged: Any, count: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert edged.contact_rows.shape[0] <= masters.DIRECT_DIRECTIONS
    rows, attachment = master_directions(edged, count)
    monkeypatch.setattr(masters, "DIRECT_DIRECTIONS", 0)
    found, moved = master_directions(edged, count)
    assert found.shape == (count, edged.local)
    # the signs may differ where a symmetric mode has two largest components
    np.testing.assert_allclose(found.T @ found, rows.T @ rows, rtol=0, atol=1e-7)
    np.testing.assert_allclose(
        moved @ found, attachment @ rows, rtol=0, atol=1e-9 * np.abs(attachment).max()
    )


def test_forbidden_direction_is_found_without_the_flexibility(
    edged: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(masters, "DIRECT_DIRECTIONS", 0)
    rows = edged.contact_rows.copy()
    rows.data[rows.indptr[4] : rows.indptr[5]] = 0.0
    monkeypatch.setattr(edged, "contact_rows", rows)
    with refusal(ErrorKind.PLACE, "contacts[0]"):
        master_directions(edged, 3)
