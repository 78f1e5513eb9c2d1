"""Scenes from TOML files, plain data or Python: read, checked and completed; their titles.

A title may hold keys in braces, such as `{loads.0.frequency}`; the heading shows their values.
If the title does not hold the key of an override, the key is appended to the title in this form.
The heading of a report therefore names every changed value, also after a second change.

Longer and shorter time steps of a scene.

The local error of a second-order scheme falls with the third power of the step. With an adaptive
step, half the step therefore means an eighth of the tolerance. The steps of this module may be
longer or shorter than a scene file allows.
"""

import os
import re
import tomllib
from collections.abc import Collection, Mapping
from dataclasses import fields, replace
from pathlib import Path, PurePath
from typing import Any

from fenicsrom.errors import ErrorKind, refuse
from fenicsrom.scene.base.rules import Where, is_sequence, read_rows, show
from fenicsrom.scene.base.tables import plain, read_table, require_none, toml_value, value_at
from fenicsrom.scene.checks.checks import default_masters, problems, step_problems
from fenicsrom.scene.keys import times
from fenicsrom.scene.keys.contacts import Contact
from fenicsrom.scene.keys.loads import EngineOrder, Load, OrderFrequency, Table, with_rows
from fenicsrom.scene.keys.places import Refinement
from fenicsrom.scene.keys.rotation import Rotation
from fenicsrom.scene.keys.schema import Geometry, Scene
from fenicsrom.scene.keys.unit_system import Units
from fenicsrom.scene.reading.overrides import (
    Overrides,
    as_given,
    names_of,
    override_table,
    override_texts,
    scene_in_si,
)


def shared_meshes() -> Path:
    """Give the folder of the program's own meshes.

    The folder lies inside the installed package; in a checkout it lies beside the package.
    """
    package = Path(__file__).resolve().parents[2]
    installed = package / "meshes"
    return installed if installed.is_dir() else package.parent / "meshes"


KEY_IN_BRACES = re.compile(r"\{([A-Za-z_][\w.]*)\}")
# changes of these keys do not change the motion of a scene
WITHOUT_EFFECT = ("title", "output", "reference", "response", "backbone", "ringdown")
LONGEST = 40  # longest text of one value in a heading


def titled(table: Mapping[str, Any], overrides: Overrides, source: str) -> dict[str, Any]:
    """Give the table of a scene with a title that holds the keys of some overrides.

    Args:
        table: the plain data of a scene, the overrides included.
        overrides: as `override_table` takes them.
        source: name of the scene file, the title of a scene that has none.
    """
    title = table.get("title", "")
    if not isinstance(title, str):
        return dict(table)
    for override in override_texts(overrides):
        path = names_of(override.partition("=")[0])
        if path[0] not in WITHOUT_EFFECT and f"{{{'.'.join(path)}}}" not in title:
            name = ".".join(path)
            title = f"{title or PurePath(source).stem}, {name} = {{{name}}}"
    return {**table, "title": title} if title else dict(table)


def scene_heading(scene: Scene, varied: Collection[str] = ()) -> str:
    """Give the title of a scene with the values of the keys that stand in braces.

    A part of the title between commas is left out if it names a key that the scene does not have,
    such as the preload of a removed contact, or a key that varies. Braces around anything else
    stay as they are. The heading of a scene without a title is the name of its file.

    Args:
        scene: the scene.
        varied: keys that have several values in the results, as in a sweep.
    """
    hidden = {".".join(names_of(key)) for key in varied}
    table = plain(scene)
    tables = {field.name for field in fields(scene)}

    def is_missing(name: str) -> bool:
        return name in hidden or (name.split(".")[0] in tables and value_at(table, name) is None)

    def shown(match: re.Match[str]) -> str:
        value = as_given(scene, match[1], value_at(table, match[1]))
        return match[0] if value is None else _short(value)

    parts = scene.title.split(", ")
    kept = [part for part in parts if not any(map(is_missing, KEY_IN_BRACES.findall(part)))]
    return KEY_IN_BRACES.sub(shown, ", ".join(kept)) or scene.source


def _short(value: Any) -> str:
    """A value in a heading: numbers without trailing zeros, text without quotes."""
    if isinstance(value, str):
        return value
    text = f"{value:.10g}" if isinstance(value, float) else toml_value(value)
    return text if len(text) <= LONGEST else f"{text[: LONGEST - 3]}.."


MESHES = (
    ".geo .msh .unv .step .stp .inp .bdf .nas .dat .cdb .vtu .vtk .pvtu .pvd .vtm .vtp "
    ".xdmf .xmf .e .exo .ex2 .med .mesh .meshb .vol .su2 .avs"
).split()
"""Suffixes of the files that `fenicsrom init` takes."""


def read_scene(
    path: str | os.PathLike[str],
    overrides: Overrides = (),
    *,
    mesh: bool = True,
    unloaded: bool = False,
) -> Scene:
    """Read a scene from a TOML file.

    Args:
        path: the file.
        overrides: one or several texts KEY=VALUE that replace values of the file, such as
            "loads.0.force=150", or a dict such as {"loads.0.force": 150.0}. The title names them.
        mesh: whether to look for the mesh file. A stored model needs no mesh: False takes the path
            as it is.
        unloaded: whether the scene may be without loads, contacts and probe, for its modes only.

    Returns:
        The scene, with every default filled in.

    Raises:
        SceneError: the file cannot be read, is not TOML, or does not describe a scene.
        TypeError: the argument is no path.

    Example:
        >>> import fenicsrom as fr
        >>> scene = fr.read_scene("demos/slip_liftoff_2d.toml", "loads.0.force=150")
        >>> scene.loads[0].size, scene.contacts[0].friction
        (150.0, 0.5)
    """
    if not isinstance(path, str | os.PathLike):
        raise TypeError(
            f"read_scene: {type(path).__name__}: must be a path of a scene file; make_scene takes "
            "tables, and fenicsrom.run and others take a scene"
        )
    source = os.fspath(path)
    table = override_table(read_toml(source), overrides, source)
    table, folder = titled(table, overrides, source), Path(path).parent
    return parse_scene(table, source, folder, mesh=mesh, unloaded=unloaded)


def make_scene(*, folder: str | os.PathLike[str] = ".", **tables: Any) -> Scene:
    """Make a scene in Python, with the same checks and defaults as for a file.

    Args:
        folder: folder to which the paths of the mesh and of tables are relative.
        tables: the tables and keys of a scene file, as plain data or as the dataclasses of this
            package.

    Raises:
        SceneError: a key or value is not allowed.

    Example:
        >>> import fenicsrom as fr
        >>> steel = {"young": 207e9, "poisson": 0.28, "density": 7801.0}
        >>> shaken = {"group": "load", "direction": [0, 0, 1], "force": 100.0, "frequency": 3.0}
        >>> scene = fr.make_scene(
        ...     geometry={"mesh": "beam3d.geo", "dimension": 3},
        ...     material=steel,
        ...     supports=[{"group": "root"}],
        ...     loads=[shaken],
        ... )
        >>> scene.time.scheme, round(scene.period, 6)  # the defaults are filled in
        ('discrete-gradient', 0.333333)
    """
    return parse_scene(
        {name: plain(table) for name, table in tables.items()}, "scene", Path(folder)
    )


def parse_scene(
    table: Mapping[str, Any],
    source: str,
    folder: Path | None,
    *,
    mesh: bool = True,
    unloaded: bool = False,
) -> Scene:
    """Make a scene from plain data.

    Args:
        table: the data, as TOML or JSON gives it.
        source: name of the data in messages, usually that of the file.
        folder: folder to which the path of the mesh is relative. None takes the path as it is and
            does not look for the file, because a reduced model needs no mesh.
        mesh: whether to look for the mesh file in the folder; the files of tables are read anyway.
        unloaded: whether the scene may be without loads, contacts and probe.

    Returns:
        The scene, with every default filled in.

    Raises:
        SceneError: one sentence that names the source, the key, its value and what is allowed.

    Example:
        >>> import tomllib
        >>> import fenicsrom as fr
        >>> with open("demos/open_2d.toml", "rb") as file:
        ...     table = tomllib.load(file)
        >>> table["loads"][0]["frequency"] = 3.1
        >>> fr.parse_scene(table, "open_2d", None).loads[0].frequency
        3.1
    """
    where = Where(source)
    if not isinstance(table, Mapping):
        raise refuse(source, "must be a table", ErrorKind.TYPE)
    scene = _checked(table, where, unloaded)
    if not (scene.units.is_si or scene.units.si):
        scene = _checked(scene_in_si(table, scene, scene.units), where, unloaded)
    scene = _complete(scene, folder, folder if mesh else None)
    require_none(step_problems(scene), scene, where)
    return scene


def _checked(table: Mapping[str, Any], where: Where, unloaded: bool) -> Scene:
    """Make a scene from plain data, without the defaults that depend on other keys.

    Raises:
        SceneError: a key or value is not allowed.
    """
    scene = read_table(Scene, _with_frequencies(table, where), where)
    require_none(problems(scene, unloaded), scene, where)
    return replace(scene, source=where.source)


def scene_table(scene: Scene) -> dict[str, Any]:
    """Give the plain data of a scene, fit for JSON; `parse_scene` makes the same scene from it."""
    table: dict[str, Any] = plain(scene)
    for entry in table["loads"]:
        if isinstance(frequency := entry.get("frequency"), OrderFrequency):
            del entry["frequency"]
            entry["engine_order"] = frequency.order
    return table


def read_toml(source: str) -> dict[str, Any]:
    """Read a TOML file.

    Raises:
        SceneError: the file cannot be read or is not TOML.
    """
    try:
        return tomllib.loads(Path(source).read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise refuse(source, f"cannot be read: {error.strerror}", ErrorKind.FILE) from None
    except ValueError as error:
        hint = f"; for a mesh file, `fenicsrom init {source}` writes a scene"
        text = f"is not TOML: {error}{hint if Path(source).suffix.lower() in MESHES else ''}"
        raise refuse(source, text) from None


def _with_frequencies(table: Mapping[str, Any], where: Where) -> Mapping[str, Any]:
    """Replace the engine orders of the loads by frequencies in the table of a scene."""
    loads = table.get("loads")
    if not is_sequence(loads):
        return table
    return {**table, "loads": [_with_frequency(table, k, where) for k in range(len(loads))]}


def _with_frequency(table: Mapping[str, Any], index: int, where: Where) -> Any:
    load = table["loads"][index]
    if not isinstance(load, Mapping) or "engine_order" not in load:
        return load
    place = where.at("loads").at(index)
    given = read_table(EngineOrder, {"engine_order": load["engine_order"]}, place).engine_order
    place = place.at("engine_order")
    if "frequency" in load:
        raise place.refuse(given, "not allowed with frequency", ErrorKind.CONFLICT)
    speed = 0.0
    if "rotation" in table:
        speed = read_table(Rotation, table["rotation"], where.at("rotation")).speed_rpm
    if not speed:
        allowed = "only allowed with a rotation.speed_rpm other than 0"
        raise place.refuse(given, allowed, ErrorKind.CONFLICT)
    kept = {name: value for name, value in load.items() if name != "engine_order"}
    return {**kept, "frequency": OrderFrequency.at(given, speed)}


def _complete(scene: Scene, folder: Path | None, mesh_folder: Path | None) -> Scene:
    """Find the files of the scene, and fill in the defaults that depend on other keys."""
    probe = scene.probe
    if probe is None and not scene.contacts:
        places = (load.place for load in scene.loads if not load.everywhere)
        probe = next(places, None)
    rotation = scene.rotation
    if rotation is not None and rotation.point is None:
        rotation = replace(rotation, point=(0.0,) * scene.geometry.dimension)
    cyclic = scene.cyclic
    if cyclic is not None:
        axis, point = cyclic.axis, cyclic.point
        if rotation is not None:
            axis, point = axis or rotation.axis, point or rotation.point
        cyclic = replace(cyclic, axis=axis, point=point or (0.0,) * scene.geometry.dimension)
    basis = scene.basis
    if scene.contacts:
        basis = replace(basis, masters=default_masters(scene))
    where = Where(scene.source, "loads")
    return replace(
        scene,
        geometry=_complete_geometry(scene, mesh_folder),
        time=_complete_time(scene.time, scene.period is not None),
        probe=probe,
        loads=tuple(
            _complete_load(load, folder, where.at(k), scene.units)
            for k, load in enumerate(scene.loads)
        ),
        contacts=tuple(map(_complete_contact, scene.contacts)),
        rotation=rotation,
        cyclic=cyclic,
        basis=basis,
    )


def _complete_contact(contact: Contact) -> Contact:
    """Of a contact between bodies every node is a point; one with a rigid surface has a gap."""
    if contact.against is not None:
        return replace(contact, place=replace(contact.place, at="nodes"))
    return replace(contact, gap=contact.gap or 0.0)


def _complete_geometry(scene: Scene, folder: Path | None) -> Geometry:
    geometry = scene.geometry
    if folder is not None:
        where = Where(scene.source, "geometry.mesh")
        also = (
            _find_mesh(path, folder, Where(scene.source, f"geometry.also[{k}]"))
            for k, path in enumerate(geometry.also)
        )
        mesh = _find_mesh(geometry.mesh, folder, where)
        geometry = replace(geometry, mesh=mesh, also=tuple(also))
    if geometry.mesh.suffix == ".geo" and geometry.cells is None:
        geometry = replace(geometry, cells="structured")
    if geometry.dimension == 2 and geometry.plane is None:
        geometry = replace(geometry, plane="stress")
    pairs = [(one.place.group, one.against) for one in scene.contacts]
    pairs += [(one.group, one.against) for one in scene.ties]
    groups = ((a, b) for a, b in pairs if isinstance(a, str) and isinstance(b, str))
    geometry = replace(geometry, apart=tuple(groups))
    if geometry.is_cad and geometry.meshing.near is None:
        keyed = [(f"supports[{k}].group", one.group) for k, one in enumerate(scene.supports)]
        keyed += [(f"contacts[{k}].group", one.place.group) for k, one in enumerate(scene.contacts)]
        origins = {name: key for key, name in reversed(keyed) if name is not None}
        names = dict.fromkeys(name for _, name in keyed if name is not None)
        near = tuple(Refinement(group=name, origin=origins[name]) for name in names)
        geometry = replace(geometry, meshing=replace(geometry.meshing, near=near))
    return geometry


def _complete_time(time: times.Time, periodic: bool) -> times.Time:
    if time.scheme == times.GENERALISED_ALPHA and time.spectral_radius is None:
        time = replace(time, spectral_radius=0.8)
    if not periodic:
        return time
    if isinstance(time.stepping, times.NoStep):
        time = replace(time, stepping=times.StepsPerPeriod(steps_per_period=200))
    if isinstance(time.span, times.EquilibriumOnly):
        time = replace(time, span=times.Periodic())
    if isinstance(time.span, times.Periodic) and time.span.steady_tolerance is None:
        tolerance = max(1e-5, time.tolerance or 0.0)
        time = replace(time, span=replace(time.span, steady_tolerance=tolerance))
    return time


def _complete_load(load: Load, folder: Path | None, where: Where, units: Units) -> Load:
    if isinstance(load.history, Table) and isinstance(load.history.table, Path):
        rows = _read_table(load.history.table, folder, where.at("table"))
        return with_rows(load, tuple((float(units.in_si(t, "s")), factor) for t, factor in rows))
    return load


def _read_table(path: Path, folder: Path | None, where: Where) -> tuple[tuple[float, float], ...]:
    """Read the rows of a text file: time in s and factor.

    Commas, semicolons or spaces separate the columns; one line of headings is allowed.
    """
    found = (folder or Path()) / path
    if not os.path.isfile(found):
        inside = f"a file in {(folder or Path()).absolute()}"
        searched = "an existing file" if path.is_absolute() else inside
        raise where.refuse(str(path), f"must be {searched}", ErrorKind.FILE)
    try:
        lines = found.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeError):
        allowed = "must be a text file that can be read"
        raise where.refuse(str(path), allowed, ErrorKind.FILE) from None
    rows: list[Any] = []
    numbers: list[int] = []
    headed = False
    for line_number, line in enumerate(lines, 1):
        words = re.split(r"\s*[,;]\s*|\s+", line.strip())
        if words == [""] or words[0].startswith("#"):
            continue
        try:
            rows.append([float(word) for word in words])
        except ValueError:
            if not rows and not headed:
                headed = True
                continue
            rows.append(line)
        numbers.append(line_number)

    def line_of(index: int) -> Where:
        return replace(where, key=f"{where.key} = {show(str(path))}: line {numbers[index]}")

    return read_rows(rows, where, line_of)


def _find_mesh(mesh: Path, folder: Path, where: Where) -> Path:
    """Find the mesh file: in the folder of the scene, else among the program's own meshes."""
    folders = [folder, shared_meshes()]
    for candidate in (parent / mesh for parent in folders):
        if os.path.isfile(candidate):
            return candidate.resolve()
    inside = f"a file in {folders[0].absolute()} or {folders[1]}"
    searched = "an existing file" if mesh.is_absolute() else inside
    raise where.refuse(str(mesh), f"must be {searched}", ErrorKind.FILE)


def step_key(scene: Scene) -> str:
    """The key of [time] that sets the step of a scene."""
    return fields(scene.time.stepping)[0].name


def with_time(scene: Scene, **changes: Any) -> Scene:
    """The scene with other values of [time]; a new step replaces the old one.

    Args:
        scene: the scene.
        changes: values by key. A new scheme resets `spectral_radius` to its default.

    Raises:
        SceneError: a value is not allowed.
    """
    table = scene_table(scene)
    if changes.get("scheme", scene.time.scheme) != scene.time.scheme:
        table["time"].pop("spectral_radius", None)
    overrides = [f"time.{key}={value!r}" for key, value in changes.items()]
    return parse_scene(override_table(table, overrides, scene.source), scene.source, None)


def refined(scene: Scene, factor: float = 2) -> Scene:
    """The scene with its step divided by a factor (its tolerance by the factor cubed).

    With a factor below 1 the step is longer; no step exceeds the duration, and a period has at
    least two.
    """
    stepping: times.Stepping
    match scene.time.stepping:
        case times.Tolerance(tolerance=tolerance):
            stepping = times.Tolerance(tolerance=tolerance / factor**3)
        case times.StepsPerPeriod(steps_per_period=steps):
            stepping = times.StepsPerPeriod(steps_per_period=max(int(steps * factor), 2))
        case times.StepsPerRevolution(steps_per_revolution=steps):
            stepping = times.StepsPerRevolution(steps_per_revolution=max(int(steps * factor), 2))
        case times.FixedStep(step=step):
            assert scene.time.duration is not None
            stepping = times.FixedStep(step=min(step / factor, scene.time.duration))
        case other:
            stepping = other
    return replace(scene, time=replace(scene.time, stepping=stepping))


def coarser(scene: Scene) -> Scene:
    """The scene with twice its step or eight times its tolerance, as `refined` by a half."""
    return refined(scene, 0.5)
