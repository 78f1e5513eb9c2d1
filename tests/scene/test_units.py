"""The units of the numbers of a scene."""

from __future__ import annotations

import pytest
from support import beam_scene

from fenicsrom.scene import Contact
from fenicsrom.scene.keys.unit_system import Units, table_in_si
from fenicsrom.scene.reading.overrides import in_words, unit_of


@pytest.mark.parametrize(
    ("key", "unit"),
    [
        ("loads.0.frequency", "Hz"),
        ("contacts.0.preload", "N"),
        ("contacts.0.friction", ""),
        ("contacts.0.approach.0.1", ""),
        ("material.density", "kg/m³"),
        ("no.such.key", ""),
        ("frequency", "Hz"),
    ],
)
def test_unit_of_a_key_is_that_of_its_table(key: str, unit: str) -> None:
    assert unit_of(beam_scene(2), key) == unit


@pytest.mark.parametrize(
    ("key", "unit"), [("normal_stiffness", ""), ("preload", ""), ("gap", "m"), ("friction", "")]
)
def test_unit_that_depends_on_the_region_of_a_contact_is_left_out(key: str, unit: str) -> None:
    scene = beam_scene(2, ("contacts.0.at='nodes'",))
    assert unit_of(scene, f"contacts.0.{key}") == unit


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("frequency", 21.1411357, "frequency = 21.1411 Hz"),
        ("loads.0.force", 25.0, "loads.0.force = 25 N"),
        ("contacts.0.friction", 0.5, "contacts.0.friction = 0.5"),
    ],
)
def test_number_in_words_has_its_unit(key: str, value: float, words: str) -> None:
    assert in_words(beam_scene(2), key, value) == words


def test_stiffness_of_bodies_that_touch_is_converted_per_area() -> None:
    table = {"group": "a", "against": "b", "normal_stiffness": 1e4, "preload": 0.8}
    for at in ({}, {"at": "nodes"}):
        found = table_in_si({**table, **at}, Contact, Units(length="mm", mass="t"))
        assert (found["normal_stiffness"], found["preload"]) == (1e13, 8e5)
