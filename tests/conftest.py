"""Solids that several test files use, made once per session."""

from __future__ import annotations

import os
from typing import Any

import pytest
from support import beam_scene, make_solid

os.environ["FENICSROM_CACHE"] = "off"  # of tests and of the processes that they start


@pytest.fixture(scope="session")
def beam2d() -> Any:
    """The paper's beam in plane stress, 20 elements."""
    pytest.importorskip("dolfinx")
    return make_solid(beam_scene(2))


@pytest.fixture(scope="session")
def beam3d() -> Any:
    """The paper's beam of 20 hexahedra, contact and load as means over their sections."""
    pytest.importorskip("dolfinx")
    return make_solid(beam_scene(3, ("loads.0.at='mean'", "contacts.0.at='mean'")))


@pytest.fixture(scope="session")
def bent2d() -> Any:
    """A short beam in plane stress about its equilibrium under a large static load."""
    pytest.importorskip("dolfinx")
    return make_solid(bent_scene(2))


@pytest.fixture(scope="session")
def bent3d() -> Any:
    """The short beam of tetrahedra, under an oblique static load."""
    pytest.importorskip("dolfinx")
    return make_solid(bent_scene(3, "geometry.cells='simplex'"))


def bent_scene(dimension: int, *overrides: str) -> Any:
    """A short beam with a static load that turns its tip by about 0.2 rad, and a harmonic one."""
    sizes = ["length=1.0", "height=0.05", "elements_along=6", "load_at=0.5"] + ["width=0.04"] * (
        dimension == 3
    )
    push = {
        "group": "tip",
        "direction": [0.3, 1.0, 0.5][:dimension],
        "force": 1.5e4 if dimension == 2 else 2e4,
    }
    shake = {
        "group": "load",
        "direction": [0.0, 1.0, 0.0][:dimension],
        "force": 10.0,
        "frequency": 30.0,
    }
    parameters = tuple(f"geometry.parameters.{size}" for size in sizes)
    return beam_scene(dimension, (*parameters, *overrides), loads=[shake, push])
