"""The table of references, as Markdown: `python3 tests/references.py` writes it into README.md.

A test that compares with something outside the program says so in a paragraph of its docstring:
"Reference: what is compared | its source | the value there | ours | what the test allows".
"""

from __future__ import annotations

import ast
import re
from pathlib import Path

TESTS = Path(__file__).parent
PARAGRAPH = re.compile(r"^Reference: (.+?)(?=\n\n|\Z|\nReference: )", re.DOTALL | re.MULTILINE)
PART = re.compile(r"(?<=<!-- references: begin -->\n).*(?=<!-- references: end -->)", re.DOTALL)
HEAD = "| what | source | reference | ours | allowed |\n|---|---|---|---|---|\n"


def references_of(file: Path) -> list[str]:
    """The rows of the tests in a file.

    Raises:
        ValueError: a paragraph has not five fields.
    """
    rows = []
    for node in ast.parse(file.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.FunctionDef) and node.name.startswith("test_"):
            for text in PARAGRAPH.findall(ast.get_docstring(node) or ""):
                fields = " ".join(text.split()).split(" | ")
                if len(fields) != 5:
                    raise ValueError(f"{file.name}, {node.name}: {len(fields)} fields, not 5")
                fields[0] = f"[{fields[0]}]({file.relative_to(TESTS).as_posix()})"
                rows.append(f"| {' | '.join(fields)} |\n")
    return rows


def table() -> str:
    """The table with the rows of all tests."""
    rows = [row for file in sorted(TESTS.glob("*/test_*.py")) for row in references_of(file)]
    return f"\n{HEAD}{''.join(rows)}\n"


def replaced(page: str) -> str:
    """The page with the current table between its markers."""
    return PART.sub(lambda _: table(), page)


if __name__ == "__main__":
    readme = TESTS / "README.md"
    readme.write_text(replaced(readme.read_text(encoding="utf-8")), encoding="utf-8")
