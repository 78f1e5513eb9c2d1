"""The drawing process: pyvista renders the body, matplotlib adds captions, Pillow writes GIFs."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from fenicsrom.post.style import STATES, magnification, new_figure, styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FILM_SECONDS = 3.0  # duration of an animation


def draw_motion() -> None:
    """Draw a motion as an animated GIF; the task is on the command line."""
    import pyvista

    task = json.loads(sys.argv[1])
    motion = pyvista.get_reader(task["motion"])
    points = pyvista.get_reader(task["points"]) if task["points"] else None

    def at(reader: Any, time: float) -> Any:
        reader.set_active_time_value(time)
        return reader.read()[0]

    vectors = [np.array(at(motion, time).point_data["displacement"]) for time in motion.time_values]
    grid = at(motion, motion.time_values[0])
    if task["rest"]:
        rest = np.array(pyvista.read(task["rest"]).point_data["displacement"])
        vectors = [frame - rest for frame in vectors]
        grid.points = np.asarray(grid.points) + rest
    largest = max(float(np.linalg.norm(frame, axis=1).max()) for frame in vectors)
    factor = magnification(largest, float(np.ptp(np.asarray(grid.points), axis=0).max()))
    camera = Camera(grid, margin=factor * largest, pixels=900)
    images = []
    for time, frame in zip(motion.time_values, vectors, strict=True):
        camera.show(grid, frame, factor, largest or 1.0)
        if points is not None:
            found = at(points, time)
            where = np.asarray(found.points) + factor * np.asarray(found.point_data["displacement"])
            camera.mark(where, [STATES[int(state)][1] for state in found.point_data["state"]])
        images.append(camera.photograph())
    camera.plotter.close()
    scale = "displacements to scale" if factor == 1.0 else f"displacements × {factor:g}"
    scale = f"from the equilibrium, {scale}" if task["rest"] else scale
    frames = film_frames(cropped(images), motion.time_values, scale, largest, points is not None)
    _write_gif(task["picture"], frames)


def draw_stress() -> None:
    """Draw the von Mises stress on a deformed body as one PNG; the task is on the command line."""
    import pyvista

    task = json.loads(sys.argv[1])
    grid = pyvista.read(task["source"])
    vectors = np.asarray(grid.point_data["displacement"])
    stress = np.asarray(grid.point_data["von Mises"])
    largest = float(np.linalg.norm(vectors, axis=1).max())
    factor = magnification(largest, float(np.ptp(np.asarray(grid.points), axis=0).max()))
    camera = Camera(grid, margin=factor * largest)
    camera.face(grid, int(np.argmax(stress)))
    peak = float(stress.max()) or 1.0
    camera.show(grid, vectors, factor, largest or 1.0, (stress / peak, "turbo"))
    place = np.asarray(grid.points)[int(np.argmax(stress))]
    moved = place + factor * vectors[int(np.argmax(stress))]
    camera.mark(moved[None], ["#FFFFFF"])
    (image,) = cropped([camera.photograph()])
    camera.plotter.close()
    scale = "displacements to scale" if factor == 1.0 else f"displacements × {factor:g}"
    stress_panel(image, peak, task["title"], f"{task['label']} ({scale})").savefig(task["picture"])


def _write_gif(path: str, images: Sequence[np.ndarray]) -> None:
    """Write pictures as an animated GIF with one palette for all frames."""
    from PIL import Image

    sample = Image.fromarray(np.concatenate(images[:: max(1, len(images) // 8)]))
    common = sample.quantize(250, dither=Image.Dither.NONE)
    # the colours of the marks cover too few pixels to enter the palette by themselves
    kept = [(0, 0, 0), (255, 255, 255), *(_rgb(colour) for _, colour in STATES.values())]
    common.putpalette([*common.getpalette()[: 3 * 250], *np.ravel(kept)])
    frames = [
        Image.fromarray(image).quantize(palette=common, dither=Image.Dither.NONE)
        for image in images
    ]
    frames[0].save(
        path,
        save_all=True,
        append_images=frames[1:],
        duration=round(1e3 * FILM_SECONDS / len(frames)),
        loop=0,
    )


class Camera:
    """An off-screen camera that looks at the broad side of a body.

    Attributes:
        length: largest extent of the body, m.
        towards: unit vector from the body to the camera.
        plotter: the pyvista plotter.
    """

    def __init__(self, grid: Any, margin: float = 0.0, pixels: int = 1600):
        """Look at an undeformed grid with a margin (m) for its displacements."""
        import pyvista

        self._points = np.asarray(grid.points)
        extent = np.ptp(self._points, axis=0)
        self.length = float(extent.max())
        thin, middle, along = np.eye(3)[np.argsort(extent, kind="stable")]
        self._flat = extent[2] < 1e-12 * self.length
        if self._flat:
            direction, self._up = np.array([0.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0])
        elif along[2]:
            direction, self._up = 0.25 * along - 0.65 * thin + 0.75 * middle, along
        else:
            direction, self._up = 0.12 * along + 0.45 * thin + 0.85 * middle, thin
        self.towards = direction / np.linalg.norm(direction)
        self._scale = 0.75 * float(np.linalg.norm(extent)) + margin
        self.plotter = pyvista.Plotter(off_screen=True, window_size=[pixels, pixels])
        self.plotter.set_background("white")
        self.plotter.enable_anti_aliasing("ssaa")
        self.plotter.enable_parallel_projection()
        undeformed = grid.extract_surface(nonlinear_subdivision=2).clean()
        self._outline = undeformed.extract_feature_edges(
            feature_angle=40.0, manifold_edges=False, non_manifold_edges=False
        )

    def face(self, grid: Any, node: int) -> None:
        """Look from a side from which a node of the grid is seen, if it is on the boundary."""
        if self._flat:
            return
        surface = grid.extract_surface(nonlinear_subdivision=0)
        surface = surface.compute_normals(
            cell_normals=False, split_vertices=False, auto_orient_normals=True
        )
        place = np.asarray(grid.points)[node]
        normal = np.asarray(surface.point_data["Normals"])[surface.find_closest_point(place)]
        if normal @ self.towards < 0.0:
            across = self.towards - (self.towards @ self._up) * self._up
            turned = [self.towards - 2.0 * across, self.towards * np.where(self._up, -1.0, 1.0)]
            self.towards = max([-self.towards, *turned], key=lambda side: float(normal @ side))

    def show(
        self,
        grid: Any,
        vectors: np.ndarray,
        factor: float,
        largest: float,
        colour: tuple[np.ndarray, str] | None = None,
    ) -> None:
        """Show the body displaced by factor times the vectors (n, 3).

        The colour is the length of a vector relative to the largest, or the given values (n,) from
        0 to 1 by a colour map of this name.
        """
        values, colours = colour or (np.linalg.norm(vectors, axis=1) / largest, "viridis")
        self.plotter.clear_actors()
        self.plotter.add_mesh(self._outline, color="#8c8c8c", line_width=2, render=False)
        shape = grid.copy()
        shape.clear_data()
        shape.point_data["size"] = values
        shape.points = self._points + factor * vectors
        self.plotter.add_mesh(
            shape.extract_surface(nonlinear_subdivision=2),
            scalars="size",
            cmap=colours,
            clim=(0, 1),
            show_scalar_bar=False,
            lighting=not self._flat,
            smooth_shading=not self._flat,
            split_sharp_edges=not self._flat,
            ambient=0.5,
            diffuse=0.6,
            render=False,
        )

    def mark(self, places: np.ndarray, colours: Sequence[str]) -> None:
        """Mark places (P, 3) with dots of these colours, in front of the body."""
        import pyvista

        marks = pyvista.PolyData(places + 2 * self.length * self.towards)
        marks.point_data["colour"] = [_rgb(colour) for colour in colours]
        for size, how in ((21, {"color": "black"}), (15, {"scalars": "colour", "rgb": True})):
            self.plotter.add_points(
                marks,
                point_size=size,
                render_points_as_spheres=True,
                lighting=False,
                render=False,
                **how,
            )
            marks = marks.translate(0.1 * self.length * self.towards)

    def photograph(self) -> np.ndarray:
        """Take a picture, (pixels, pixels, 3)."""
        camera = self.plotter.camera
        camera.focal_point = (self._points.max(axis=0) + self._points.min(axis=0)) / 2
        camera.position = camera.focal_point + 5 * self.length * self.towards
        camera.up = self._up
        camera.parallel_scale = self._scale
        self.plotter.reset_camera_clipping_range()
        self.plotter.render()
        return np.asarray(self.plotter.screenshot(return_img=True))


def cropped(images: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Cut off the margin that is white in all pictures, except for 20 pixels."""
    drawn = np.array([(image < 250).any(axis=2) for image in images]).any(axis=0)
    rows, columns = (np.flatnonzero(drawn.any(axis=axis)) for axis in (1, 0))
    box = (
        slice(max(rows[0] - 20, 0), rows[-1] + 20),
        slice(max(columns[0] - 20, 0), columns[-1] + 20),
    )
    return [image[box] for image in images]


@styled
def stress_panel(image: np.ndarray, peak: float, title: str, label: str) -> Figure:
    """Add a title and a colour bar in MPa to a picture of stresses.

    Args:
        image: picture (height, width, 3).
        peak: largest stress, Pa.
        title: title of the picture.
        label: label of the colour bar.
    """
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    height, width = image.shape[:2]
    wide = 9.6 * min(1.0, max(0.6, width / height))
    figure = new_figure(wide, wide * height / width + 1.2)
    axis = figure.subplots()
    axis.set_axis_off()
    axis.imshow(image, interpolation="antialiased")
    axis.set_title(title, fontsize=11)
    bar = figure.colorbar(
        ScalarMappable(Normalize(0.0, 1e-6 * peak), "turbo"),
        ax=axis,
        location="bottom",
        shrink=0.5,
        aspect=40,
    )
    bar.set_label(label)
    bar.outline.set_visible(False)
    return figure


@styled
def film_frames(
    images: Sequence[np.ndarray], times: Sequence[float], scale: str, largest: float, marked: bool
) -> list[np.ndarray]:
    """Add the time, a colour bar and a legend of the contact states to the pictures of a motion.

    Args:
        images: pictures of the same size (height, width, 3).
        times: one per picture, s.
        scale: caption that says how displacements are scaled.
        largest: displacement at the end of the colour bar, m.
        marked: whether the pictures have marks at contact points.

    Returns:
        Pictures of the same size (height, width, 3), of bytes.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize
    from matplotlib.lines import Line2D

    height, width = images[0].shape[:2]
    wide = 7.2 * min(1.0, max(0.5, width / height))
    figure = new_figure(wide, wide * height / width + 1.3)
    figure.set_dpi(100)
    canvas = FigureCanvasAgg(figure)
    axis = figure.subplots()
    axis.set_axis_off()
    shown = axis.imshow(images[0], interpolation="antialiased")
    bar = figure.colorbar(
        ScalarMappable(Normalize(0.0, 1e3 * largest or 1.0), "viridis"),
        ax=axis,
        location="bottom",
        shrink=0.5,
        aspect=40,
    )
    bar.set_label(f"displacement, mm ({scale})")
    bar.outline.set_visible(False)
    if marked:
        marks = [
            Line2D(
                [], [], linestyle="", marker="o", markeredgecolor="black", color=colour, label=name
            )
            for name, colour in STATES.values()
        ]
        figure.legend(handles=marks, loc="outside upper right", ncols=len(marks))
    found = []
    for image, time in zip(images, times, strict=True):
        shown.set_data(image)
        axis.set_title(f"t = {time:#.6g} s", loc="left", fontsize=11)
        canvas.draw()
        found.append(np.asarray(canvas.buffer_rgba())[..., :3].copy())
    return found


def _rgb(colour: str) -> tuple[int, ...]:
    """Split a colour such as "#0072B2" into its three bytes."""
    return tuple(bytes.fromhex(colour[1:]))
