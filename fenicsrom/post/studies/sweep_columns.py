"""The numbers of a sweep that its tables and pictures show, and its keys with their units."""

from __future__ import annotations

from typing import NamedTuple

from fenicsrom.assess.studies.sweep_runs import Sweep
from fenicsrom.scene.reading.units import given_unit_of


class Column(NamedTuple):
    """A column of `sweep.csv`.

    Attributes:
        key: its name there.
        factor: from the unit there to the one that is shown.
        head: its head in tables.
        label: its label in pictures; empty if it has no picture.
    """

    key: str
    factor: float
    head: str
    label: str


COLUMNS = (
    Column("amplitude_normal_m", 1e3, "normal mm", "normal amplitude, mm"),
    Column("amplitude_tangential_m", 1e3, "tangential mm", "tangential amplitude, mm"),
    Column("amplitude_x_m", 1e3, "x mm", "amplitude in x, mm"),
    Column("amplitude_y_m", 1e3, "y mm", "amplitude in y, mm"),
    Column("amplitude_z_m", 1e3, "z mm", "amplitude in z, mm"),
    Column("peak_normal_force_N", 1.0, "peak N", "largest normal force, N"),
    Column("largest_multiplier", 1.0, "largest Floquet multiplier", ""),
)


def key_labels(found: Sweep, keys: tuple[str, ...], join: str = ", ") -> list[str]:
    """Keys with their units."""
    units = [given_unit_of(found.scene, key) for key in keys]
    return [f"{key}{join}{unit}" if unit else key for key, unit in zip(keys, units, strict=True)]
