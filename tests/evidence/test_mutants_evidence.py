"""The mutants of the numerical core: how they are changed and drawn."""

from __future__ import annotations

import ast
from collections import Counter

import mutants

SOURCE = """
def f(x: float = 0.5) -> float:
    if x < 1 and not g(x):
        raise ValueError(f"{x + 1}")
    y[i, j] += -min(x, 60.0)
"""
CHANGED = [
    "def f(x: float=1.5) -> float:",
    "if x < 1 or not g(x):",
    "if x > 1 and (not g(x)):",
    "if x >= 1 and (not g(x)):",
    "if x <= 1 and (not g(x)):",
    "if x < 2 and (not g(x)):",
    "if x < 1 and (not not g(x)):",
    "pass",
    "y[i, j] -= -min(x, 60.0)",
    "y[j, i] += -min(x, 60.0)",
    "y[i, j] += +min(x, 60.0)",
    "y[i, j] += -max(x, 60.0)",
    "y[i, j] += -min(x, 1.0)",
]


def test_changes_are_those_of_the_code_without_messages_and_annotations() -> None:
    before = ast.unparse(ast.parse(SOURCE)).splitlines()
    found = []
    for k in range(len(list(mutants.changes(ast.parse(SOURCE))))):
        tree = ast.parse(SOURCE)
        list(mutants.changes(tree))[k][1]()
        after = ast.unparse(tree).splitlines()
        (line,) = (new.strip() for old, new in zip(before, after, strict=True) if old != new)
        found.append(line)
    assert sorted(found) == sorted(CHANGED)


def test_mutants_are_drawn_of_every_package_in_turn() -> None:
    found = mutants.draw(60, 1)
    assert found == mutants.draw(60, 1)
    assert len(set(found)) == 60
    packages = [module.split(".")[0] if "." in module else "" for module, _ in found]
    assert set(packages) == {
        module.split(".")[0] if "." in module else "" for module in mutants.MODULES
    }
    assert max(Counter(packages).values()) - min(Counter(packages).values()) <= 1
