"""The axes of `fenicsrom stability`: they follow from the scene's own values."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support import beam_scene, linear_model

from fenicsrom.assess.studies.axes import Scales, buckling_preload, cases_of, scales_of
from fenicsrom.assess.studies.stability import build
from fenicsrom.scene import Scene

EULER = np.pi**2 * 207e9 * 0.0254**4 / 12.0 / (4.0 * 2.54**2)  # N, clamped and free
AXIAL = 207e9 * 0.0254**2 / 2.54  # N/m
BENDING = 3.0 * 207e9 * 0.0254**4 / 12.0 / 2.54**3  # N/m, at the tip


def in_units(length: float, mass: float, time: float) -> Scene:
    """The beam of the tests; one unit is so many m, kg and s."""
    force = mass * length / time**2
    values = {
        "geometry.parameters.length": 2.54 / length,
        "geometry.parameters.height": 0.0254 / length,
        "geometry.thickness": 0.0254 / length,
        "material.young": 207e9 / (force / length**2),
        "material.density": 7801.0 * length**3 / mass,
        "material.mass_damping": 5.0 * time,
        "loads.0.force": 111.29 / force,
        "loads.0.frequency": 3.2 * time,
        "contacts.0.preload": 40.0 / force,
        "contacts.0.normal_stiffness": 1e4 * length / force,
        "contacts.0.tangential_stiffness": 1e4 * length / force,
    }
    return beam_scene(2, tuple(f"{key}={value!r}" for key, value in values.items()))


def scales(scene: Scene) -> Scales:
    pytest.importorskip("dolfinx")
    return scales_of(build(scene, "reduced")[0], scene)


def test_scales_of_the_beam_match_beam_theory() -> None:
    found = scales(beam_scene(2))
    assert found.normal_stiffness[0] == pytest.approx(AXIAL, rel=2e-3)
    assert found.tangential_stiffness[0] == pytest.approx(BENDING, rel=5e-3)
    assert found.preload is not None and found.preload[0] == pytest.approx(EULER, rel=5e-3)
    assert found.omega == pytest.approx(2.0 * np.pi * 3.28, rel=2e-3)


def number(override: str) -> tuple[str, float | str]:
    key, _, value = override.partition("=")
    try:
        return key, float(value)
    except ValueError:
        return key, value


def test_axes_do_not_depend_on_the_units() -> None:
    """In mm, t and s every axis has the same factors as in SI."""
    length, mass, time = 1e-3, 1e3, 1.0
    force = mass * length / time**2
    unit = {
        "normal_stiffness": force / length,
        "tangential_stiffness": force / length,
        "preload": force,
        "force": force,
        "frequency": 1.0 / time,
        "mass_damping": 1.0 / time,
    }
    one, other = (
        cases_of(scene, scales(scene)) for scene in (beam_scene(2), in_units(length, mass, time))
    )
    assert one[1] == other[1]
    assert [(c.axis, c.value, c.model) for c in one[0]] == [
        (c.axis, c.value, c.model) for c in other[0]
    ]
    for case, same in zip(*(found[0] for found in (one, other)), strict=True):
        for ours, theirs in zip(case.overrides, same.overrides, strict=True):
            (key, value), (other_key, other_value) = number(ours), number(theirs)
            assert key == other_key
            if isinstance(value, float):
                assert isinstance(other_value, float)
                scale = unit.get(key.split(".")[-1], 1.0)
                assert other_value * scale == pytest.approx(value, rel=1e-5), key
            else:
                assert value == other_value


def test_axes_scale_with_the_length_of_the_beam() -> None:
    """Twice as long: bending stiffness falls by 8, axial stiffness by 2, buckling load by 4."""
    short, long = scales(beam_scene(2)), scales(beam_scene(2, ("geometry.parameters.length=5.08",)))
    assert short.preload is not None and long.preload is not None
    assert short.normal_stiffness[0] / long.normal_stiffness[0] == pytest.approx(2.0, rel=2e-3)
    ratio = short.tangential_stiffness[0] / long.tangential_stiffness[0]
    assert ratio == pytest.approx(8.0, rel=5e-3)
    assert short.preload[0] / long.preload[0] == pytest.approx(4.0, rel=5e-3)
    assert short.omega / long.omega == pytest.approx(4.0, rel=5e-3)


MADE_UP = Scales((2.0,), (3.0,), (7.0,), 11.0)


def overrides(scene: Scene, axis: str, scales: Scales = MADE_UP) -> dict[str, tuple[str, ...]]:
    return {case.value: case.overrides for case in cases_of(scene, scales, [axis])[0]}


def test_contact_axes_are_multiples_of_the_scales() -> None:
    scene = beam_scene(2)
    assert overrides(scene, "contact stiffness")["100 times the body's"] == (
        "contacts.0.normal_stiffness=200.0",
        "contacts.0.tangential_stiffness=300.0",
    )
    assert overrides(scene, "preload")["0.5 times the buckling load"] == ("contacts.0.preload=3.5",)
    without = replace(MADE_UP, preload=None)
    assert overrides(scene, "preload", without)["3 times the preload"] == (
        "contacts.0.preload=120.0",
    )


def test_damping_axis_is_in_damping_ratios() -> None:
    assert overrides(beam_scene(2), "damping")["ratio 0.1"] == (
        f"material.mass_damping={0.2 * 11.0!r}",
    )


def test_linear_model_has_no_buckling_load() -> None:
    model = linear_model(np.eye(2), np.diag([60.0, 30.0]), masters=2)
    assert buckling_preload(model, beam_scene(2, geometrically_nonlinear=False)) is None
