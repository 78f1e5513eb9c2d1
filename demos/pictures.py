"""Draw the pictures of the README pages from the output folders of the demos.

    docker/run python3 demos/pictures.py
    docker/run python3 demos/pictures.py --runs out --pictures demos/pictures

A demo without an output folder in `--runs` is run first. Every picture stays below 300 kB.
"""

from __future__ import annotations

import argparse
import csv
import json
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import pyvista as pv
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

import fenicsrom as fr

DEMOS = Path(__file__).parent
BEAMS = ("open_2d", "slip_liftoff_2d", "slip_liftoff_3d", "stick_slip_2d", "high_load_2d")
COMMANDS = {
    **dict.fromkeys(BEAMS, "run"),
    "lap_joint": "run",
    "blade_modes": "modes",
    "blade_pressed": "run",
    "blade_campbell": "campbell",
    "disk": "modes",
    "disk_shrouds": "response",
    "response_2d": "response",
    "shaker_2d": "response",
    "backbone_2d": "backbone",
    "arch_snap": "statics",
    "blade_rub": "run",
    "blade_run_up": "run",
    "blade_abradable": "run",
    "blade_composite": "run",
    "blade_response": "response",
    "rotor37_map": "map",
}
STATES = {-1: ("open", "#9AA0A6"), 0: ("slip", "#E69F00"), 1: ("stick", "#009E73")}
SELECTIONS = {"none": "#0072B2", "mmi": "#D55E00", "mmi-nls": "#009E73", "all": "#CC79A7"}
STYLE = {
    "font.size": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlesize": 9,
    "axes.titlelocation": "left",
    "legend.frameon": False,
    "savefig.dpi": 110,
}
MODE_SCALE = 0.15  # largest displacement of a drawn mode, relative to the span
LIGHT = np.array([0.3, -0.5, 0.8]) / np.linalg.norm([0.3, -0.5, 0.8])


def run_missing(runs: Path) -> None:
    """Run the demos and the comparison that have no output folder in `runs` yet."""
    wanted = {name: (command, name) for name, command in COMMANDS.items()}
    wanted["compare"] = ("compare", "slip_liftoff_2d")
    for folder, (command, scene) in wanted.items():
        if not (runs / folder / "report.html").exists():
            path = DEMOS / f"{scene}.toml"
            arguments = [command, str(path), "--output", str(runs / folder)]
            subprocess.run([sys.executable, "-m", "fenicsrom", *arguments], check=True)


# ------------------------------------------------------------------ beams


def last_period(folder: Path, model: str = "reduced") -> dict[str, np.ndarray]:
    """Time (periods), displacement (m), force (N) and state of contact point 1 in the last period.

    Without contact the displacement is that of the probe, and the state is open.
    """
    summary = json.loads((folder / "summary.json").read_text())
    with np.load(folder / "history.npz") as history:
        time = history[f"{model}_time"]
        period = (time[-1] - time[0]) / summary["response"][model]["periods"]
        kept = time >= time[-1] - period * (1.0 + 1e-9)
        displacement, state = history[f"{model}_displacement"], history[f"{model}_state"]
        force = history[f"{model}_force"]
    touches = state.shape[1] > 0
    return {
        "time": (time[kept] - time[kept][0]) / period,
        "displacement": displacement[kept, 0],
        "force": force[kept, 0] if touches else np.zeros((kept.sum(), 2)),
        "state": state[kept, 0] if touches else np.full(kept.sum(), -1),
    }


def coloured_by_state(axes: Axes, x: np.ndarray, y: np.ndarray, state: np.ndarray) -> None:
    """Draw a curve whose steps have the colour of the contact state at their end."""
    for value, (_, colour) in STATES.items():
        inside = state == value
        inside[:-1] |= inside[1:]
        part = np.where(inside, 1.0, np.nan)
        axes.plot(x * part, y * part, color=colour, linewidth=2.2, zorder=3)


def state_legend(axes: Axes, states: Sequence[int], **options: Any) -> None:
    """Name the colours of the contact states."""
    lines = [Line2D([], [], color=STATES[s][1], linewidth=2.2) for s in states]
    axes.legend(lines, [STATES[s][0] for s in states], **options)


def draw_path(axes: Axes, folder: Path) -> None:
    """Draw the path of the tip in one period, coloured by the contact state."""
    motion = last_period(folder)
    x = 1e3 * motion["displacement"]
    coloured_by_state(axes, x[:, 1], x[:, 0], motion["state"])
    axes.set(xlabel="across the beam, mm", ylabel="along the beam, mm", title="path of the tip")


def draw_loop(axes: Axes, folder: Path) -> None:
    """Draw the friction loop of the reduced model, with the full model behind it if it was run."""
    with np.load(folder / "history.npz") as history:
        full_was_run = "full_time" in history.files
    if full_was_run:
        motion = last_period(folder, "full")
        x, force = 1e3 * motion["displacement"][:, 1], motion["force"][:, 1]
        axes.plot(x, force, color="#D0D4D8", linewidth=6.0, zorder=1, label="full model")
    motion = last_period(folder)
    x, force = 1e3 * motion["displacement"][:, 1], motion["force"][:, 1]
    coloured_by_state(axes, x, force, motion["state"])
    axes.set(
        xlabel="tangential displacement, mm", ylabel="friction force, N", title="friction loop"
    )


def draw_history(axes: Axes, folder: Path) -> None:
    """Draw the displacement of the tip across the beam over one period."""
    for model, colour, width in (("full", "#D0D4D8", 6.0), ("reduced", "#0072B2", 1.8)):
        motion = last_period(folder, model)
        axes.plot(motion["time"], 1e3 * motion["displacement"][:, 1], color=colour, linewidth=width)
    axes.set(xlabel="time / period", ylabel="across the beam, mm", title="motion of the tip")


def beam_picture(folder: Path) -> Figure:
    """Draw the path of the tip and the friction loop, or the motion if there is no contact."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(6.4, 2.3), layout="constrained")
    draw_path(left, folder)
    if folder.name == "open_2d":
        draw_history(right, folder)
        return figure
    draw_loop(right, folder)
    present = [int(s) for s in STATES if (last_period(folder)["state"] == s).any()]
    state_legend(left, present, loc="lower center", ncols=len(present), fontsize=8)
    return figure


# ------------------------------------------------------------------ blades


def skin(grid: pv.DataSet, vectors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Triangles (k, 3, 3) of the surface moved by `vectors`, and |vectors| at their centres."""
    moved = grid.copy()
    moved["size"] = np.linalg.norm(vectors, axis=1)
    moved.points = np.asarray(grid.points, float) + vectors
    surface = moved.extract_surface(nonlinear_subdivision=2).triangulate()
    corners = surface.faces.reshape(-1, 4)[:, 1:]
    return np.asarray(surface.points)[corners], np.asarray(surface["size"])[corners].mean(axis=1)


def draw_skin(
    axes: Any, triangles: np.ndarray, values: np.ndarray | None = None, largest: float = 1.0
) -> None:
    """Draw a surface, shaded, with colours by `values` or grey and transparent without."""
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None]
    shade = 0.6 + 0.4 * np.abs(normal @ LIGHT)
    if values is None:
        colours = np.tile([0.6, 0.63, 0.66, 0.18], (len(triangles), 1))
    else:
        colours = plt.get_cmap("viridis")(values / largest)
        colours[:, :3] *= shade[:, None]
    axes.add_collection3d(Poly3DCollection(triangles, facecolors=colours, edgecolors="none"))


def frame_view(
    axes: Any, points: np.ndarray, elevation: float, azimuth: float, zoom: float = 1.25
) -> None:
    """Show all points at equal scales, without axes."""
    low, high = points.min(axis=0), points.max(axis=0)
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    axes.set_proj_type("ortho")
    axes.set_box_aspect(high - low, zoom=zoom)
    axes.view_init(elev=elevation, azim=azimuth)
    axes.set_axis_off()


def modes_picture(folder: Path) -> Figure:
    """Draw the normal modes of the blade, coloured by the size of the displacement."""
    grid = pv.read(folder / "normal_modes.vtu")
    summary = json.loads((folder / "summary.json").read_text())
    span = np.ptp(np.asarray(grid.points), axis=0).max()
    figure = plt.figure(figsize=(6.4, 1.9))
    labels = [name for name in grid.point_data if "_Hz_" in name][:4]
    for k, label in enumerate(labels):
        axes = figure.add_axes((0.25 * k, 0.0, 0.25, 0.88), projection="3d", computed_zorder=False)
        vectors = np.asarray(grid[label], float)
        vectors *= MODE_SCALE * span / np.linalg.norm(vectors, axis=1).max()
        still = skin(grid, np.zeros_like(vectors))[0]
        moved, size = skin(grid, vectors)
        draw_skin(axes, still)
        draw_skin(axes, moved, size, size.max())
        frame_view(axes, np.concatenate([still.reshape(-1, 3), moved.reshape(-1, 3)]), 25, -35, 1.1)
        hertz = summary["frequencies_Hz"][k]
        figure.text(0.25 * k + 0.125, 0.9, f"{label.split('_')[0]}   {hertz:.1f} Hz", ha="center")
    return figure


def pressed_picture(folder: Path) -> Figure:
    """Draw the pressed blade in its equilibrium over the undeformed one."""
    grid = pv.read(folder / "equilibrium.vtu")
    vectors = np.asarray(grid[grid.point_data.keys()[0]], float)
    still = skin(grid, np.zeros_like(vectors))[0]
    moved, size = skin(grid, vectors)
    figure = plt.figure(figsize=(4.2, 2.0))
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0), projection="3d", computed_zorder=False)
    draw_skin(axes, still)
    draw_skin(axes, moved, size, size.max())
    frame_view(axes, np.concatenate([still.reshape(-1, 3), moved.reshape(-1, 3)]), 25, -35, 1.15)
    figure.text(0.03, 0.9, f"60 kPa: tip displacement {1e3 * size.max():.0f} mm at most")
    return figure


def draw_rub(axes: Any, folder: Path) -> None:
    """Draw the rubbing blade at the instant of the largest normal force, with its contact points.

    Points in contact carry a line in the direction of the force on the body.
    """
    files = sorted((folder / "contact_points").glob("*.vtp"))
    points = [pv.read(path) for path in files]
    force = [np.linalg.norm(p["normal_force_vector_N"], axis=1).max() for p in points]
    instant = int(np.argmax(force))
    body = pv.read(sorted((folder / "motion").glob("*.vtu"))[instant])
    moved, size = skin(body, np.asarray(body["displacement_m"], float))
    draw_skin(axes, moved, size, size.max())
    cloud = points[instant]
    here = np.asarray(cloud.points, float) + np.asarray(cloud["displacement_m"], float)
    state = np.asarray(cloud["contact_state"]).ravel()
    arrows = np.asarray(cloud["normal_force_vector_N"], float) / max(force)
    for value, (_, colour) in STATES.items():
        for place, arrow in zip(here[state == value], arrows[state == value], strict=True):
            tail = place - 0.12 * arrow
            axes.plot(*np.stack([tail, place]).T, color=colour, linewidth=1.6)
            axes.plot(*place[:, None], marker="o", markersize=2.6, color=colour)
    frame_view(axes, np.concatenate([moved.reshape(-1, 3), here]), 25, -35, 1.3)


def paraview_picture(folder: Path) -> Figure:
    """Render what `results.pvd` opens: the blade with its stresses, its casing and the contact."""
    reader = pv.get_reader(folder / "results.pvd")
    points = pv.get_reader(folder / "contact_points" / "contact_points.pvd")
    forces = []
    for instant in points.time_values:
        points.set_active_time_value(instant)
        forces.append(float(points.read()[0]["normal_force_N"].max()))
    reader.set_active_time_value(reader.time_values[int(np.argmax(forces))])
    blocks = reader.read()[0]
    plotter = pv.Plotter(off_screen=True, window_size=[1500, 700])
    plotter.set_background("white")
    plotter.add_mesh(blocks["surface_1"], color="#B8BDC2", opacity=0.35)
    body = (
        blocks["motion"].warp_by_vector("displacement_m").extract_surface(nonlinear_subdivision=3)
    )
    bar = {"title": "von_mises_Pa", "color": "black", "vertical": True, "fmt": "%.3g"}
    plotter.add_mesh(body, scalars="von_mises_Pa", cmap="turbo", scalar_bar_args=bar)
    cloud = blocks["contact_points"].warp_by_vector("displacement_m")
    plotter.add_mesh(cloud, color="black", point_size=9, render_points_as_spheres=True)
    plotter.camera_position = [(-0.5, -1.3, 0.9), (0.4, 0.0, 0.02), (0.0, 0.0, 1.0)]
    plotter.camera.zoom(1.9)
    image = np.asarray(plotter.screenshot(return_img=True))
    plotter.close()
    figure = plt.figure(figsize=(7.5, 3.5))
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.imshow(image)
    axes.set_axis_off()
    return figure


def rub_picture(folder: Path) -> Figure:
    """Draw the rubbing blade, and the normal forces of its contact points over a revolution."""
    figure = plt.figure(figsize=(6.4, 2.5))
    left = figure.add_axes((0.0, 0.0, 0.52, 1.0), projection="3d", computed_zorder=False)
    draw_rub(left, folder)
    right = figure.add_axes((0.62, 0.2, 0.36, 0.68))
    with np.load(folder / "history.npz") as history:
        time, force = history["reduced_time"], history["reduced_force"][:, :, 0]
    kept = time >= time[-1] - 0.02 * (1.0 + 1e-9)
    touching = np.flatnonzero(force[kept].max(axis=0) > 0.0)
    for point in touching:
        right.plot(
            (time[kept] - time[kept][0]) / 0.02, force[kept][:, point], label=f"point {point + 1}"
        )
    right.set(xlabel="revolution", ylabel="normal force, N", title="contact points that touch")
    if touching.size > 5:  # beside the curves
        right.set_position((0.58, 0.2, 0.27, 0.68))
        right.legend(fontsize=7, loc="center left", bbox_to_anchor=(1.0, 0.5))
    else:
        right.legend(fontsize=7, loc="upper center")
    return figure


# ------------------------------------------------------------------ diagrams


def wear_picture(folder: Path) -> Figure:
    """Draw the worn depth over the angle of the casing, where the tip wore it."""
    rows = np.genfromtxt(folder / "wear.csv", delimiter=",", names=True)
    figure, axes = plt.subplots(figsize=(6.4, 2.5), layout="constrained")
    for place in np.unique(rows["position_m"]):
        mine = rows[rows["position_m"] == place]
        if mine["depth_m"].any():
            label = f"{1e3 * place:.0f} mm along the axis"
            axes.plot(mine["angle_deg"], 1e6 * mine["depth_m"], label=label)
    axes.set(xlabel="angle of the casing, degrees", ylabel="worn depth, µm", xlim=(0.0, 360.0))
    axes.set_xticks(np.arange(0.0, 361.0, 45.0))
    axes.legend(fontsize=7, loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure


def campbell_picture(folder: Path) -> Figure:
    """Draw the frequencies over the speed, the engine orders and the critical speeds."""
    data = json.loads((folder / "campbell.json").read_text())
    speeds, hertz = np.array(data["speeds_rpm"]), np.array(data["frequencies_Hz"])
    figure, axes = plt.subplots(figsize=(4.4, 2.6), layout="constrained")
    for order in data["engine_orders"]:
        axes.plot(speeds, order * speeds / 60.0, color="#B8BDC2", linewidth=0.9)
        edge = min(speeds[-1], 60.0 * 500.0 / order)
        axes.annotate(f"EO {order}", (edge, order * edge / 60.0), fontsize=7, color="#666666")
    axes.plot(speeds, hertz, linewidth=1.8)
    for meeting in data["critical_speeds"]:
        axes.plot(meeting["speed_rpm"], meeting["frequency_Hz"], "o", color="k", mfc="w", ms=4)
    axes.set(xlim=(0, speeds[-1] * 1.06), ylim=(0, 510), xlabel="speed, rpm", ylabel="Hz")
    return figure


def backbone_picture(folder: Path) -> Figure:
    """Draw frequency and damping ratio of a nonlinear mode over its amplitude."""
    with open(folder / "backbone.csv") as file:
        rows = list(csv.DictReader(file))
    peaks = json.loads((folder / "backbone.json").read_text())["peaks"]
    size = 1e3 * np.array([float(row["amplitude_y_m"]) for row in rows])
    figure, (upper, lower) = plt.subplots(2, sharex=True, figsize=(4.4, 3.2), layout="constrained")
    upper.plot(size, [float(row["frequency_Hz"]) for row in rows], color="#0072B2", linewidth=1.6)
    upper.plot(
        [1e3 * peak["probe_amplitude_m"] for peak in peaks],
        [peak["frequency_Hz"] for peak in peaks],
        "o",
        color="#D55E00",
        mfc="w",
        ms=4,
        label="forced peaks",
    )
    upper.legend()
    upper.set_ylabel("frequency, Hz")
    lower.plot(size, [100.0 * float(row["damping_ratio"]) for row in rows], color="#0072B2")
    lower.set(xscale="log", xlabel="amplitude of the probe, mm", ylabel="damping ratio, %")
    return figure


def path_picture(folder: Path) -> Figure:
    """Draw the force on an arch over the displacement of its crown, unstable parts dashed."""
    with open(folder / "equilibria.csv") as file:
        rows = list(csv.DictReader(file))
    down = -1e3 * np.array([float(row["probe_y_m"]) for row in rows])
    factor = np.array([float(row["load_factor"]) for row in rows])
    special = np.array([row["kind"] for row in rows])
    stable = np.array([row["negative_pivots"] == "0" for row in rows])
    figure, axes = plt.subplots(figsize=(4.4, 2.6), layout="constrained")
    look = {"color": "#0072B2", "linewidth": 1.6}
    axes.plot(down, np.where(stable | (special != ""), factor, np.nan), **look)
    axes.plot(down, np.where(~stable | (special != ""), factor, np.nan), **look, ls=(0, (3, 2)))
    for kind, marker, colour in (("limit point", "o", "#D55E00"), ("bifurcation", "D", "#009E73")):
        here = special == kind
        axes.plot(down[here], factor[here], marker, color=colour, mfc="w", ms=4, label=kind)
    axes.set(xlabel="displacement of the crown, mm", ylabel="load factor")
    axes.legend()
    return figure


def draw_response(
    axes: Axes, folder: Path, quantity: tuple[str, float], parameter: str, family: str
) -> None:
    """Draw a column of response curves, unstable parts dashed, with their folds.

    Args:
        axes: where to draw.
        folder: output folder of the scene.
        quantity: the column, and the factor for it.
        parameter: the column of the parameter.
        family: the column of the second number.
    """
    with open(folder / "response.csv") as file:
        rows = list(csv.DictReader(file))
    for number, value in enumerate(dict.fromkeys(row[family] for row in rows)):
        mine = [row for row in rows if row[family] == value]
        place = np.array([float(row[parameter]) for row in mine])
        size = quantity[1] * np.array([float(row[quantity[0]]) for row in mine])
        fold = np.array([row["event"] == "fold" for row in mine])
        stable = np.array([row["stability"] in ("stable", "not judged") for row in mine])
        look = {"color": list(SELECTIONS.values())[number], "linewidth": 1.6}
        axes.plot(place, np.where(stable | fold, size, np.nan), **look, label=f"{float(value):g}")
        axes.plot(place, np.where(~stable | fold, size, np.nan), "--", **look)
        axes.plot(place[fold], size[fold], "o", color=look["color"], mfc="w", ms=4)


def response_picture(
    folder: Path, family: str, title: str, amplitude: str = "amplitude_y_m"
) -> Figure:
    """Draw the amplitudes of a body over the frequency; `title` names the family."""
    figure, axes = plt.subplots(figsize=(4.4, 2.6), layout="constrained")
    draw_response(axes, folder, (amplitude, 1e3), "frequency_Hz", family)
    axes.set(xlabel="frequency, Hz", ylabel="amplitude, mm")
    axes.legend(fontsize=7, title=title, title_fontsize=7)
    return figure


def blade_response_picture(folder: Path) -> Figure:
    """Draw the amplitude and the peak normal force of the rubbing blade over the pressure."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(6.4, 2.5), layout="constrained")
    columns = "loads.0.pressure_Pa", "contacts.0.gap_m"
    draw_response(left, folder, ("amplitude_tangential_2_m", 1e3), *columns)
    draw_response(right, folder, ("peak_normal_force_N", 1.0), *columns)
    left.set(xlabel="pressure, Pa", ylabel="amplitude, mm")
    right.set(xlabel="pressure, Pa", ylabel="peak normal force, N")
    left.legend(fontsize=7, title="gap, m", title_fontsize=7)
    return figure


def draw_front(axes: Axes, folder: Path) -> None:
    """Draw the error of every basis against its online time, without the full model."""
    data = json.loads((folder / "comparison.json").read_text())
    for one in data["combinations"]:
        axes.plot(
            1e3 * one["online_median_seconds"],
            one["error_percent"]["amplitude_tangential"],
            marker="o" if one["method"] == "rubin" else "s",
            color=SELECTIONS[one["derivatives"]],
            markersize=4,
            linestyle="none",
        )
    seconds = data["full"]["seconds"]
    axes.axvline(1e3 * seconds, color="k", linestyle=":", linewidth=1.0)
    axes.annotate("full model ", (1e3 * seconds, 1e-4), rotation=90, ha="right", fontsize=8)
    axes.set(xscale="log", yscale="log", xlabel="run time, ms", ylabel="amplitude error, %")
    axes.set_title("32 bases: error against run time")
    lines = [Line2D([], [], color=c, marker="o", linestyle="none") for c in SELECTIONS.values()]
    names = [f"derivatives: {name}" for name in SELECTIONS]
    axes.legend(lines, names, fontsize=7, loc="upper center", bbox_to_anchor=(0.58, 0.86))


def run_up_picture(folder: Path) -> Figure:
    """Draw amplitude, normal force and shaft torque of each revolution over the speed."""
    rows = np.genfromtxt(folder / "run_up.csv", delimiter=",", names=True)
    drawn = (
        ("amplitude, mm", 1e3 * rows["amplitude_m"], "#0072B2"),
        ("normal force, N", rows["peak_normal_force_N"], "#D55E00"),
        ("shaft torque, N m", rows["shaft_torque_Nm"], "#009E73"),
    )
    figure, axes = plt.subplots(1, 3, figsize=(8.4, 2.4), layout="constrained")
    for axis, (name, values, colour) in zip(axes, drawn, strict=True):
        axis.plot(rows["speed_rpm"], values, color=colour, marker=".", markersize=3)
        axis.set(title=name, xlabel="speed, rpm")
    return figure


def joint_picture(folder: Path) -> Figure:
    """Draw the vibration of the tip of a joint and the energy that friction dissipates."""
    motion = fr.read_history(folder / "history.npz")["reduced"]
    assert motion.probe is not None
    drawn = (
        ("tip, mm", 1e3 * motion.probe[:, 1], "#0072B2"),
        ("energy dissipated by friction, mJ", 1e3 * motion.friction_dissipation, "#D55E00"),
    )
    figure, axes = plt.subplots(1, 2, figsize=(7.4, 2.4), layout="constrained")
    for axis, (name, values, colour) in zip(axes, drawn, strict=True):
        axis.plot(1e3 * motion.time, values, color=colour)
        axis.set(title=name, xlabel="time, ms")
    return figure


def compare_picture(folder: Path) -> Figure:
    """Draw error against run time of all bases of a comparison."""
    figure, axes = plt.subplots(figsize=(4.4, 2.9), layout="constrained")
    draw_front(axes, folder)
    return figure


def overview_picture(runs: Path) -> Figure:
    """Draw the picture of the README: rubbing blade, friction loop, error against run time."""
    figure = plt.figure(figsize=(10.5, 2.9))
    blade = figure.add_axes((0.0, 0.0, 0.36, 0.92), projection="3d", computed_zorder=False)
    draw_rub(blade, runs / "blade_rub")
    figure.text(0.02, 0.92, "fan blade rubbing its casing, 22 coordinates")
    loop = figure.add_axes((0.42, 0.19, 0.23, 0.68))
    draw_loop(loop, runs / "slip_liftoff_2d")
    loop.set_title("beam: friction loop")
    grey = Line2D([], [], color="#D0D4D8", linewidth=6.0)
    lines = [grey] + [Line2D([], [], color=STATES[s][1], linewidth=2.2) for s in (-1, 0)]
    loop.legend(lines, ["full model", "reduced, open", "reduced, slip"], fontsize=7, loc="center")
    front = figure.add_axes((0.735, 0.19, 0.255, 0.68))
    draw_front(front, runs / "compare")
    return figure


def small_picture(path: Path) -> Figure:
    """A picture of a run, 6 inches wide."""
    pixels = plt.imread(path)
    height, width = pixels.shape[:2]
    figure = plt.figure(figsize=(6.0, 6.0 * height / width))
    axis = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axis.imshow(pixels, interpolation="antialiased")
    axis.axis("off")
    return figure


def main(arguments: Sequence[str] | None = None) -> None:
    """Draw all pictures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=Path, default=Path("out"), help="folder of output folders")
    parser.add_argument("--pictures", type=Path, default=DEMOS / "pictures", help="where to draw")
    options = parser.parse_args(arguments)
    run_missing(options.runs)
    options.pictures.mkdir(parents=True, exist_ok=True)
    runs = options.runs
    with matplotlib.rc_context(STYLE):
        figures = {name: beam_picture(runs / name) for name in BEAMS}
        figures["lap_joint"] = joint_picture(runs / "lap_joint")
        figures["blade_modes"] = modes_picture(runs / "blade_modes")
        figures["blade_pressed"] = pressed_picture(runs / "blade_pressed")
        figures["blade_campbell"] = campbell_picture(runs / "blade_campbell")
        figures["response_2d"] = response_picture(
            runs / "response_2d", "loads.0.force_N", "force, N"
        )
        figures["shaker_2d"] = response_picture(
            runs / "shaker_2d", "loads.0.support_acceleration_m/s2", "supports, m/s²"
        )
        figures["disk_shrouds"] = response_picture(
            runs / "disk_shrouds", "contacts.0.friction", "friction", "probe_amplitude_x_m"
        )
        figures["backbone_2d"] = backbone_picture(runs / "backbone_2d")
        figures["arch_snap"] = path_picture(runs / "arch_snap")
        figures["blade_rub"] = rub_picture(runs / "blade_rub")
        figures["blade_run_up"] = run_up_picture(runs / "blade_run_up")
        figures["blade_abradable"] = wear_picture(runs / "blade_abradable")
        figures["blade_composite"] = rub_picture(runs / "blade_composite")
        figures["paraview"] = paraview_picture(runs / "blade_rub")
        figures["blade_response"] = blade_response_picture(runs / "blade_response")
        figures["compare"] = compare_picture(runs / "compare")
        figures["disk"] = small_picture(runs / "disk" / "shapes.png")
        figures["overview"] = overview_picture(runs)
        for name, figure in figures.items():
            path = options.pictures / f"{name}.png"
            figure.savefig(path)
            print(f"{path}  {path.stat().st_size / 1e3:.0f} kB")
    shutil.copyfile(runs / "rotor37_map" / "map.png", options.pictures / "rotor37_map.png")


if __name__ == "__main__":
    main()
