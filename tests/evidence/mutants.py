"""Mutation testing of all packages by the quick part of the tests, with Python 3.12 or later.

    python3 tests/evidence/mutants.py --output DIR [--number 60] [--seed 1]

A mutant is a module with one wrong operator, sign, constant, condition, index or statement. All
mutants are drawn before one is run, as many of each package as of the others; modules that draw
pictures are left out. The tests run once unchanged, and
record which lines each test executes. Then each mutant runs the tests that execute its line, the
shortest first, until one fails or they have taken `BUDGET`. Compiled modules run as plain Python,
by the tests of `FILES` that take less than `LIMIT`. What the folder holds is not repeated.
"""

from __future__ import annotations

import argparse
import ast
import importlib.machinery
import json
import os
import random
import re
import resource
import signal
import sys
import time as clock
from collections.abc import Callable, Iterator
from functools import partial
from itertools import islice, zip_longest
from pathlib import Path
from types import CodeType
from typing import Any

import numba
import numpy as np
import pytest

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "fenicsrom"
DRAWING = re.compile(  # modules whose errors show in pictures, and not in numbers
    "figure|picture|style|html|chart|film|drawing|marks|symbols|view|rendering|surface|centreline"
)
MODULES = sorted(
    ".".join(path.relative_to(PACKAGE).with_suffix("").parts)
    for path in PACKAGE.rglob("*.py")
    if not path.name.startswith("__") and not DRAWING.search(path.stem)
)
FOLDERS = ["tests"]
FILES = [
    f"tests/online/test_{name}.py"
    for name in (
        *("contact_law", "contact_problem", "contact_candidates", "polynomial", "energy", "step"),
        *("step_limits", "surfaces", "contact_sensitivity", "period_map", "march"),
    )
]
BUDGET = 30.0  # CPU seconds of the tests of a mutant
LIMIT = 2.0  # CPU seconds of a test of compiled modules as plain Python
SLOWER = 4.0  # a mutant hangs in a test that takes so many times its usual CPU time, and more than
FIXTURES = 20.0  # this, because another test may have made its fixtures
PATIENCE = 7200.0  # CPU seconds of everything
LARGE = 50.0  # one more than a larger number changes nothing

SWAPS: dict[type, tuple[type, ...]] = {
    **dict.fromkeys((ast.Lt, ast.LtE), (ast.Gt, ast.GtE)),
    **dict.fromkeys((ast.Gt, ast.GtE), (ast.Lt, ast.LtE)),
}
EDGES = {ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt}  # for integers
for one, other in (
    *((ast.Eq, ast.NotEq), (ast.Is, ast.IsNot), (ast.In, ast.NotIn), (ast.And, ast.Or)),
    *((ast.Add, ast.Sub), (ast.Mult, ast.Div), (ast.BitOr, ast.BitAnd)),
):
    SWAPS |= {one: (other,), other: (one,)}
SWAPS |= {ast.Pow: (ast.Mult,), ast.Mod: (ast.Mult,), ast.FloorDiv: (ast.Mult,)}
NAMES = {"min": "max", "minimum": "maximum", "any": "all", "argmin": "argmax"}
NAMES |= {new: old for old, new in NAMES.items()}
SILENT = {"isinstance", "print", "warn", "cast"}
HIDDEN = {"annotation", "returns", "decorator_list"}


def changes(tree: ast.AST) -> Iterator[tuple[ast.stmt, Callable[[], object]]]:
    """All changes of a module: the statement, and a function that changes it in place."""

    def visit(node: ast.AST, statement: Any) -> Iterator[Any]:
        if isinstance(node, (ast.Raise, ast.Assert, ast.JoinedStr)):
            return
        types_only = getattr(getattr(node, "test", None), "id", "") == "TYPE_CHECKING"
        if types_only or _called(node) in SILENT:
            return
        statement = node if isinstance(node, ast.stmt) else statement
        yield from ((statement, change) for change in _changes_of(node))
        for name, value in ast.iter_fields(node):
            for i, child in enumerate(value if isinstance(value, list) else [value]):
                if name in HIDDEN or not isinstance(child, ast.AST):
                    continue
                if _can_be_dropped(child):
                    yield child, partial(value.__setitem__, i, ast.copy_location(ast.Pass(), child))
                yield from visit(child, statement)

    return visit(tree, None)


def _called(node: Any) -> str:
    """The name of the function that a node calls, or an empty text."""
    function = getattr(node, "func", None)
    return str(getattr(function, "attr", getattr(function, "id", "")))


def _can_be_dropped(node: Any) -> bool:
    match node:
        case ast.Expr(value=ast.Call() as call):
            return _called(call) not in SILENT
        case ast.Assign(targets=[target]):
            return isinstance(target, (ast.Subscript, ast.Attribute))
        case ast.AugAssign(value=ast.JoinedStr() | ast.Constant(value=str())):
            return False
    return isinstance(node, (ast.AugAssign, ast.Continue, ast.Break))


def _changes_of(node: Any) -> Iterator[Callable[[], object]]:
    """The changes of one node, without those of its children."""
    put = partial(partial, setattr, node)
    match node:
        case ast.Compare(ops=ops, comparators=others):
            for i, (op, other) in enumerate(zip(ops, others, strict=True)):
                integer = isinstance(other, ast.Constant) and type(other.value) is int
                edge = (EDGES[type(op)],) if integer and type(op) in EDGES else ()
                for new in SWAPS[type(op)] + edge:
                    yield put("ops", [*ops[:i], new(), *ops[i + 1 :]])
        case ast.AugAssign() if not _can_be_dropped(node):
            return
        case ast.BinOp(op=op) | ast.AugAssign(op=op) | ast.BoolOp(op=op) if type(op) in SWAPS:
            yield put("op", SWAPS[type(op)][0]())
        case ast.UnaryOp(op=ast.USub()):
            yield put("op", ast.UAdd())
        case ast.UnaryOp(op=ast.Not(), operand=operand):
            yield put("operand", ast.UnaryOp(ast.Not(), operand))
        case ast.Constant(value=bool(value)):
            yield put("value", not value)
        case ast.Constant(value=int(value) | float(value)):
            yield put("value", value + 1 if abs(value) < LARGE else type(value)(1))
        case ast.Name(id=name) if name in NAMES:
            yield put("id", NAMES[name])
        case ast.Attribute(attr=name) if name in NAMES:
            yield put("attr", NAMES[name])
        case ast.Subscript(slice=ast.Tuple(elts=[first, second], ctx=context)):
            if ast.dump(first) != ast.dump(second):
                yield put("slice", ast.Tuple([second, first], context))
        case ast.If(test=test) | ast.IfExp(test=test):
            if isinstance(test, (ast.Name, ast.Attribute, ast.Call)):
                yield put("test", ast.UnaryOp(ast.Not(), test))


def path_of(module: str) -> Path:
    """The file of a module of the package."""
    return ROOT / "fenicsrom" / f"{module.replace('.', '/')}.py"


def is_compiled(module: str) -> bool:
    """Whether a module holds kernels, which run as plain Python here."""
    text = path_of(module).read_text()
    return re.search(r"^@(kernel|compiled|part)$", text, re.MULTILINE) is not None


def tree_of(module: str) -> ast.Module:
    """The syntax tree of an unchanged module."""
    return ast.parse(path_of(module).read_text(encoding="utf-8"))


def draw(number: int, seed: int) -> list[tuple[str, int]]:
    """The mutants: module and number of the change, as many of each package as of the others."""
    chance = random.Random(seed)
    packages: dict[str, list[tuple[str, int]]] = {}
    for module in MODULES:
        points = [(module, i) for i, _ in enumerate(changes(tree_of(module)))]
        packages.setdefault(module.partition(".")[0] if "." in module else "", []).extend(points)
    for points in packages.values():
        chance.shuffle(points)
    rounds = zip_longest(*packages.values())
    return [point for points in rounds for point in points if point][:number]


def mutate(module: str, index: int) -> tuple[CodeType, set[str], str]:
    """The code of a mutant, the lines of its change, and the statement before and after."""
    tree = tree_of(module)
    statement, change = next(islice(changes(tree), index, None))
    before = ast.unparse(tree).splitlines()
    change()
    ast.fix_missing_locations(tree)
    after = ast.unparse(tree).splitlines()
    first = next(
        k for k, (one, other) in enumerate(zip(before, after, strict=False)) if one != other
    )
    text = f"{before[first].strip()}  ->  {after[first].strip()}"
    inner = getattr(statement, "body", None)
    last = inner[0].lineno - 1 if inner else statement.end_lineno or 0
    lines = {f"{module}:{line}" for line in range(statement.lineno, last + 1)}
    return compile(tree, str(path_of(module)), "exec"), lines, text


def load_from(codes: dict[str, CodeType], seen: Callable[[str, CodeType], object]) -> None:
    """Let Python load modules of the package from `codes`, and show the code of all."""
    usual = importlib.machinery.SourceFileLoader.get_code

    def get_code(self: Any, name: str) -> CodeType | None:
        module = name.removeprefix("fenicsrom.")
        code = codes.get(module) or usual(self, name)
        if code is not None and module in MODULES:
            seen(module, code)
        return code

    importlib.machinery.SourceFileLoader.get_code = get_code  # type: ignore[method-assign]


class Recorder:
    """Plugin of pytest that records the lines that each test executes, and its CPU time.

    A test that takes more CPU seconds than its limit fails.
    """

    def __init__(self, limit: Callable[[str], float]) -> None:
        """Start with the limit of each test, in CPU seconds."""
        self.limit = limit
        self.tests: dict[str, dict[str, Any]] = {}
        self.lines: set[str] = set()
        sys.monitoring.use_tool_id(sys.monitoring.COVERAGE_ID, "mutants")
        sys.monitoring.register_callback(
            sys.monitoring.COVERAGE_ID, sys.monitoring.events.LINE, self.line
        )

    def see(self, module: str, code: CodeType) -> None:
        """Watch the functions of a module."""
        for inner in code.co_consts:
            if isinstance(inner, CodeType):
                sys.monitoring.set_local_events(
                    sys.monitoring.COVERAGE_ID, inner, sys.monitoring.events.LINE
                )
                self.see(module, inner)

    def line(self, code: CodeType, line: int) -> object:
        """Record a line, once for each test."""
        name = ".".join(Path(code.co_filename).relative_to(PACKAGE).with_suffix("").parts)
        self.lines.add(f"{name}:{line}")
        return sys.monitoring.DISABLE

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: Any) -> Any:
        """Time a test, and stop it at the limit."""
        self.lines.clear()
        sys.monitoring.restart_events()
        self.tests[item.nodeid] = found = {"passed": False}
        signal.signal(signal.SIGVTALRM, lambda *_: pytest.fail("too slow"))
        signal.setitimer(signal.ITIMER_VIRTUAL, self.limit(item.nodeid))
        begin = clock.process_time()
        try:
            return (yield)
        finally:
            signal.setitimer(signal.ITIMER_VIRTUAL, 0.0)
            found |= {"time": clock.process_time() - begin, "lines": sorted(self.lines)}

    def pytest_runtest_logreport(self, report: Any) -> None:
        """Note whether a test passed."""
        if report.when == "call":
            self.tests[report.nodeid]["passed"] = report.passed


def in_child(task: Callable[[], int], log: Path) -> int:
    """Run a task in a copy of this process; returns its exit code, negative for a signal."""
    sys.stdout.flush()
    child = os.fork()
    if child == 0:
        with log.open("w") as file:
            os.dup2(file.fileno(), 1)
            os.dup2(file.fileno(), 2)
        resource.setrlimit(resource.RLIMIT_CPU, (int(PATIENCE), int(PATIENCE)))
        code = 99
        try:
            code = int(task())
        finally:
            sys.stdout.flush()
            os._exit(code)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def start(plain: bool) -> list[str]:
    """Prepare a child; returns arguments of pytest."""
    if plain:
        numba.config.DISABLE_JIT = True
        np.seterr(all="ignore")  # as in compiled code
    os.chdir(ROOT)
    return ["-q", "-p", "no:cacheprovider", "-m", "not slow", "--tb=line"]


def baseline(plain: bool, path: Path) -> dict[str, Any]:
    """What each test executes, from the file or by running the tests."""

    def task() -> int:
        arguments = start(plain)
        recorder = Recorder(lambda _: LIMIT if plain else PATIENCE)
        load_from({}, recorder.see)
        pytest.main(arguments + (FILES if plain else FOLDERS), plugins=[recorder])
        passed = {name: test for name, test in recorder.tests.items() if test["passed"]}
        path.write_text(json.dumps(passed), encoding="utf-8")
        return 0

    if not path.exists():
        in_child(task, path.with_suffix(".log"))
    found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return found


def run(module: str, index: int, tests: dict[str, Any], log: Path) -> dict[str, Any]:
    """Run the tests of a mutant; how it was found, and by which sentence."""
    code, lines, text = mutate(module, index)
    own = [
        name
        for name, test in tests.items()
        if any(x.startswith(f"{module}:") for x in test["lines"])
    ]
    names = [name for name in own if not lines.isdisjoint(tests[name]["lines"])] or own
    names.sort(key=lambda name: tests[name]["time"])
    spent = np.cumsum([tests[name]["time"] for name in names])
    chosen = names[: 1 + int(np.sum(spent <= BUDGET))]

    def task() -> int:
        arguments = start(is_compiled(module))
        load_from({module: code}, lambda *_: None)
        limits = Recorder(lambda name: FIXTURES + SLOWER * tests[name]["time"])
        return pytest.main([*arguments, "-x", *chosen], plugins=[limits])

    log.touch()
    result = in_child(task, log) if chosen else 0
    told = [x for x in log.read_text(errors="replace").splitlines() if "Error" in x or "::" in x]
    if any("ERROR: not found" in sentence for sentence in told):
        raise RuntimeError(f"{told[-1]}: the tests have changed since they were recorded")
    found = {"module": module, "index": index, "lines": sorted(lines), "change": text}
    outcome = {"outcome": "killed" if result else "survived", "code": result, "by": told[-2:]}
    return found | outcome | {"tests": len(chosen), "covering": len(names)}


def main() -> None:
    """Draw the mutants, run them, and print the survivors."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--output", type=Path, required=True)
    parser.add_argument("--number", type=int, default=60)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    folder = options.output.resolve()
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "mutants.jsonl"
    done = [json.loads(x) for x in path.read_text().splitlines()] if path.exists() else []
    mutants = draw(options.number, options.seed)
    tests = {plain: baseline(plain, folder / f"tests_{plain}.json") for plain in (False, True)}
    for number, (module, index) in enumerate(mutants):
        if any((each["module"], each["index"]) == (module, index) for each in done):
            continue
        log = folder / f"{number}.log"
        done.append(run(module, index, tests[is_compiled(module)], log))
        with path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(done[-1]) + "\n")
        print(number, module, done[-1]["outcome"], done[-1]["change"], flush=True)
    killed = sum(each["outcome"] == "killed" for each in done)
    print(f"{killed} of {len(done)} mutants were killed")


if __name__ == "__main__":
    main()
