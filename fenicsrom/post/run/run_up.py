"""A motion at a speed of rotation that varies: sentence, numbers and picture."""

from dataclasses import asdict
from typing import Any

import numpy as np

from fenicsrom.assess.rotation.run_up import RunUp
from fenicsrom.post.base.picture import Picture
from fenicsrom.post.base.style import Figure, new_panels, styled

RUN_UP = "run_up.csv"
ROWS = ("time", "speed", "amplitude", "peak_force", "friction", "torque", "power")


def run_up_rows(found: RunUp) -> list[dict[str, float]]:
    """The rows of `run_up.csv`, one for each revolution."""
    columns = {
        "time_s": found.time,
        "speed_rpm": 30.0 / np.pi * found.speed,
        "amplitude_m": found.amplitude,
        "peak_normal_force_N": found.peak_force,
        "friction_dissipation_J": found.friction,
        "shaft_torque_Nm": found.torque,
        "shaft_power_W": found.power,
    }
    rows = zip(*columns.values(), strict=True)
    return [dict(zip(columns, map(float, row), strict=True)) for row in rows]


def run_up_summary(found: RunUp | None) -> dict[str, Any]:
    """The entry `run_up` of `summary.json`, without what `run_up.csv` holds."""
    if found is None:
        return {}
    worst = int(np.argmax(found.amplitude))
    whole = {name: value for name, value in asdict(found).items() if name not in ROWS}
    largest = {
        "largest_amplitude_m": found.amplitude[worst],
        "at_speed_rpm": 30.0 / np.pi * found.speed[worst],
    }
    return {"run_up": largest | whole}


def run_up_sentences(found: RunUp | None) -> list[str]:
    """State the largest amplitude of a motion at a varying speed, and what the shaft does."""
    if found is None:
        return []
    worst = int(np.argmax(found.amplitude))
    return [
        f"Speed from {30.0 / np.pi * found.speed[0]:.6g} to {30.0 / np.pi * found.speed[-1]:.6g} "
        f"rpm (means of the first and the last revolution). The largest distance from the "
        f"equilibrium of the same speed is {1e3 * found.amplitude[worst]:.4g} mm, at "
        f"{30.0 / np.pi * found.speed[worst]:.5g} rpm.",
        f"Shaft: work {found.shaft_work:.6g} J, angular momentum {found.momentum[0]:.5g} to "
        f"{found.momentum[1]:.5g} kg m²/s. The energy of the body rises by "
        f"{found.energy_rise:.6g} J. From the shaft, contacts take {found.contact_work:.5g} J and "
        f"loads {found.load_work:.5g} J. Loads and surfaces do {found.deformation_work:.6g} J of "
        f"work on the deformation; of this, damping takes {found.damping:.5g} J, friction "
        f"{found.friction_heat:.6g} J and the contact springs {found.spring_energy:.2g} J. These "
        f"works differ from the rise by {found.balance:.2g} J.",
    ]


def run_up_pictures(found: RunUp | None) -> list[Picture]:
    """List the picture of a motion at a varying speed, if it is one."""
    if found is None:
        return []
    return [Picture("Amplitude over the speed", "run_up.png", lambda: plot_run_up(found))]


@styled
def plot_run_up(found: RunUp) -> Figure:
    """Draw amplitude, peak force and shaft torque over the speed, with the critical speeds."""
    rub = bool(np.any(found.peak_force > 0.0))
    drawn = [("amplitude, mm", 1e3 * found.amplitude, "#0072B2")]
    drawn += [("peak normal force, N", found.peak_force, "#D55E00")] if rub else []
    drawn += [("shaft torque, N m", found.torque, "#009E73")]
    figure, axes = new_panels(8.0, 2.2 * len(drawn) + 0.5, len(drawn), sharex=True)
    for mode, order, speed in found.critical:
        for axis in axes:
            axis.axvline(speed, color="grey", linewidth=0.8, linestyle="--")
        axes[0].annotate(
            f"order {order}, mode {mode}",
            (speed, 1.0),
            xycoords=("data", "axes fraction"),
            rotation=90.0,
            ha="right",
            va="top",
            fontsize="x-small",
        )
    for axis, (name, values, colour) in zip(axes, drawn, strict=True):
        axis.plot(30.0 / np.pi * found.speed, values, color=colour, marker=".", markersize=3)
        axis.set_ylabel(name)
    axes[-1].set_xlabel("speed, rpm")
    return figure
