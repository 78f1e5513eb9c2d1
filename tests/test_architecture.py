"""The packages import one another in one direction, and the light ones import nothing heavy."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse
from support import fresh_python

import fenicsrom

PACKAGE = Path(fenicsrom.__file__).parent

MESH = {"dolfinx", "basix", "ufl", "ffcx", "mpi4py", "petsc4py", "slepc4py", "gmsh", "meshio"}
PICTURES = {"pyvista", "vtk", "matplotlib"}
FORBIDDEN = {
    "arrays": MESH | PICTURES | {"numba", "scipy"},
    "errors": MESH | PICTURES | {"numba", "scipy", "numpy"},
    "files": MESH | PICTURES | {"numba", "scipy"},
    "words": MESH | PICTURES | {"numba", "scipy", "numpy"},
    "notes": MESH | PICTURES | {"numba", "scipy", "numpy"},
    "scene": MESH | PICTURES | {"numba"},
    "online": MESH | PICTURES,
    "reduction": MESH | PICTURES,
    "fem": PICTURES,
    "assess": PICTURES,
}


UNKNOWN = "(a name that is computed)"


def package_order(docstring: str) -> list[str]:
    """The names on the lines with `<` in a docstring, from left to right."""
    return re.findall(r"\w+", "".join(line for line in docstring.splitlines() if "<" in line))


def places_in(package: str) -> dict[str, int]:
    """The place of each module in the order that a package states; empty without an order."""
    path = PACKAGE.joinpath(*package.split(".")[1:], "__init__.py")
    docstring = ast.get_docstring(ast.parse(path.read_text())) or ""
    return {name: place for place, name in enumerate(package_order(docstring))}


PLACE = places_in("fenicsrom")
ROOMS = {name: places_in(f"fenicsrom.{name}") for name in PLACE if (PACKAGE / name).is_dir()}
"""The order inside each package that states one."""
ORDERED = [name for name, places in ROOMS.items() if places]


def imported_modules(source: str, module: str) -> Iterator[tuple[int, str]]:
    """Every import of a module: its line, and the absolute name of what it imports.

    Imports inside functions and under TYPE_CHECKING count too, and so do the calls
    `import_module("name")` and `__import__("name")`.

    Args:
        source: the text of the module.
        module: its name, such as "fenicsrom.online.step.step".
    """
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield node.lineno, alias.name
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                base = ".".join(filter(None, [*module.split(".")[: -node.level], base]))
            for alias in node.names:  # `from fenicsrom import online` imports a package, too
                yield node.lineno, f"{base}.{alias.name}"
        elif isinstance(node, ast.Call) and node.args:
            called = getattr(node.func, "attr", getattr(node.func, "id", ""))
            if called in ("import_module", "__import__"):
                first = node.args[0]
                named = isinstance(first, ast.Constant)
                yield node.lineno, str(first.value) if named else UNKNOWN


def back_edges(source: str, module: str) -> list[str]:
    """The imports of a module that run against the order of the packages."""
    own = PLACE[module.split(".")[1]]
    found = []
    for line, name in imported_modules(source, module):
        parts = name.split(".")
        if name == UNKNOWN:
            found.append(f"{module}:{line} imports a module whose name is computed")
        if parts[0] != "fenicsrom" or name == "fenicsrom.__version__":
            continue
        if len(parts) == 1 or parts[1] not in PLACE:
            found.append(f"{module}:{line} imports {name}, which has no place in the order")
        elif PLACE[parts[1]] > own:
            found.append(f"{module}:{line} imports {name}, which is to its right")
        elif parts[1] == module.split(".")[1] in ORDERED and parts[2:]:
            found += against_rooms(module, line, name)
    return found


def against_rooms(module: str, line: int, name: str) -> list[str]:
    """The import of another room of the same package, if it runs against the order of the rooms.

    The package itself may import from all of its rooms.
    """
    package, own = f"{module}.".split(".")[1:3]
    other = name.split(".")[2]
    places = ROOMS[package]
    if other not in places:
        return [f"{module}:{line} imports {name}, which has no place in the order of {package}"]
    if own in places and places[other] > places[own]:
        return [f"{module}:{line} imports {name}, which is to its right in {package}"]
    return []


def circles(imports: dict[str, set[str]]) -> list[list[str]]:
    """Modules that import one another, as sorted groups: the strong components of the graph.

    Args:
        imports: module -> the modules that it imports.
    """
    names = sorted(imports)
    links = [(a, names.index(b)) for a, name in enumerate(names) for b in imports[name] & {*names}]
    graph = scipy.sparse.coo_array(
        (np.ones(len(links)), tuple(zip(*links, strict=True)) if links else ([], [])),
        shape=(len(names), len(names)),
    )
    _, label = scipy.sparse.csgraph.connected_components(graph, connection="strong")
    groups = [[n for n, k in zip(names, label, strict=True) if k == one] for one in set(label)]
    return sorted(group for group in groups if len(group) > 1)


def heavy_imports(source: str, module: str) -> list[str]:
    """The imports of a module that its package must do without."""
    forbidden = FORBIDDEN.get(module.split(".")[1], set())
    return [
        f"{module}:{line} imports {name}"
        for line, name in imported_modules(source, module)
        if name.split(".")[0] in forbidden
    ]


def module_name(path: Path) -> str:
    """The dotted name of a file of the package."""
    parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {
    module_name(path): path.read_text()
    for path in sorted(PACKAGE.rglob("*.py"))
    if path.parent != PACKAGE or path.stem not in ("__init__", "__main__")
}


def test_package_order_names_every_package_and_nothing_else() -> None:
    on_disk = {name.split(".")[1] for name in MODULES}
    assert set(PLACE) == on_disk


@pytest.mark.parametrize("name", sorted(PLACE))
def test_package_imports_only_from_its_left(name: str) -> None:
    found = [
        edge
        for module, source in MODULES.items()
        if module.split(".")[1] == name
        for edge in back_edges(source, module)
    ]
    assert not found, "\n".join(found)


@pytest.mark.parametrize("package", sorted(ORDERED))
def test_order_of_rooms_names_every_room_and_nothing_else(package: str) -> None:
    on_disk = {name.split(".")[2] for name in MODULES if name.startswith(f"fenicsrom.{package}.")}
    assert set(ROOMS[package]) == on_disk


@pytest.mark.slow
def test_no_modules_import_one_another_types_included() -> None:
    found = {
        module: {
            name if name in MODULES else name.rpartition(".")[0]
            for _, name in imported_modules(source, module)
        }
        for module, source in MODULES.items()
    }
    assert not circles(found)


@pytest.mark.parametrize(
    ("module", "source", "count"),
    [
        ("fenicsrom.online.contact.law", "from fenicsrom.online.step.state import Trial", 1),
        ("fenicsrom.online.contact.law", "from fenicsrom.online.kernels import dense", 0),
        ("fenicsrom.online.step.step", "from fenicsrom.online.contact.law import force", 0),
        ("fenicsrom.scene", "from fenicsrom.scene.reading.reading import read_scene", 0),
        ("fenicsrom.scene.keys.loads", "from fenicsrom.scene import Load", 1),
    ],
)
def test_import_against_the_order_of_rooms_is_found(module: str, source: str, count: int) -> None:
    assert len(back_edges(source, module)) == count


@pytest.mark.parametrize("name", sorted(FORBIDDEN))
def test_package_imports_nothing_heavy(name: str) -> None:
    found = [
        use
        for module, source in MODULES.items()
        if module.split(".")[1] == name
        for use in heavy_imports(source, module)
    ]
    assert not found, "\n".join(found)


@pytest.mark.parametrize(
    "source",
    [
        "from fenicsrom.study import run",
        "from fenicsrom import study",
        "from ..study import run",
        "def f():\n    from fenicsrom.study import run",
        "import_module(f'fenicsrom.{name}')",
        "if TYPE_CHECKING:\n    from fenicsrom.study import Study",
    ],
)
def test_import_against_the_order_is_found_in_every_form(source: str) -> None:
    assert len(back_edges(source, "fenicsrom.online.step.step")) == 1


@pytest.mark.parametrize(
    "source", ["import dolfinx.fem", "def f():\n    import pyvista", "__import__('dolfinx.fem')"]
)
def test_heavy_import_is_found_in_every_form(source: str) -> None:
    assert len(heavy_imports(source, "fenicsrom.online.step.step")) == 1
    assert not heavy_imports(source, "fenicsrom.post.export")


LIGHT = """
import importlib, sys
for name in {blocked!r}:
    sys.modules[name] = None  # an import of it raises
for name in {modules!r}:
    importlib.import_module(name)
"""


def test_light_packages_import_without_mesh_and_picture_modules() -> None:
    light = [name for name in MODULES if name.split(".")[1] in ("scene", "online", "reduction")]
    code = LIGHT.format(blocked=sorted(MESH | PICTURES), modules=light)
    fresh_python(code)


def test_modules_of_the_commands_of_stored_models_need_no_dolfinx() -> None:
    modules = (
        *("assess.curves.backbone", "assess.curves.checks", "assess.curves.response"),
        *("assess.studies.interaction", "exchange.export", "post.reports", "post.run.pictures"),
        *("study", "study.curves", "study.sweeps", "study.stored"),
    )
    program = (
        f"import importlib, sys; sys.modules.update(dict.fromkeys({sorted(MESH)}))\n"
        f"for name in {modules}: importlib.import_module('fenicsrom.' + name)"
    )
    fresh_python(program)


def named_in_docs() -> Iterator[tuple[str, str]]:
    """Each module, and each name of a module or of what is in one that it quotes."""
    for path in sorted(PACKAGE.rglob("*.py")):
        for found in re.findall(
            r"`((?:fenicsrom\.)?[a-z_]+\.[a-z_.]+[A-Za-z_]*)`", path.read_text()
        ):
            name = found.removeprefix("fenicsrom.")
            if (PACKAGE / name.split(".")[0]).is_dir() and not name.endswith((".toml", ".json")):
                yield str(path.relative_to(PACKAGE)), f"fenicsrom.{name}"


def is_there(name: str) -> bool:
    """Whether a name is that of a module, or of something defined in one."""
    path = PACKAGE.parent.joinpath(*name.split("."))
    if path.is_dir() or path.with_suffix(".py").exists():
        return True
    last = re.escape(path.name)
    defined = re.compile(rf"^\s*(?:(?:def|class|from .*) {last}\b|{last}\s*[,:=])", re.MULTILINE)
    sources = [folder.with_suffix(".py") for folder in (path.parent, path.parent.parent)]
    sources.append(path.parent / "__init__.py")
    return any(source.exists() and defined.search(source.read_text()) for source in sources)


def test_docstrings_name_modules_that_exist() -> None:
    assert not [quoted for quoted in named_in_docs() if not is_there(quoted[1])]
    assert not is_there("fenicsrom.online.step.loop")
    assert not is_there("fenicsrom.online.step.step.LOOP_SHARE")
