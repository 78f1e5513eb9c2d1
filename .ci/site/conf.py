"""The site of the pages and docstrings, made by Sphinx: `.ci/site/build`."""

import re
from pathlib import Path
from typing import Any

from docutils.nodes import SkipNode
from latex2mathml.converter import convert

project = "fenicsrom"
root_doc = "README"
include_patterns = ["*.md", "[a-z]*/*.md", "demos/paper/*.md"]
exclude_patterns = ["out"]
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
html_theme = "furo"
html_show_sourcelink = False
html_copy_source = False
html_math_renderer = "mathml"

myst_heading_anchors = 3
myst_fence_as_directive = ["math"]

default_role = "code"
smartquotes = False
autodoc_default_options = {"members": True, "imported-members": True}
autodoc_type_aliases = {"Array": "Array"}
autodoc_preserve_defaults = True
napoleon_use_ivar = True

TABLE_OF_CONTENTS = """
```{toctree}
:hidden:
:caption: Guide

demos/README
demos/tutorial
demos/loads
demos/contact
demos/rotation
demos/limits
demos/tools
demos/time
demos/curves
demos/sweeps
demos/stresses
demos/exchange
demos/paraview
meshes/README
```

```{toctree}
:hidden:
:caption: Reference

demos/commands
demos/files
demos/keys
demos/keys_loads
demos/keys_analysis
demos/keys_studies
fenicsrom/api
```

```{toctree}
:hidden:
:caption: Background

fenicsrom/README
demos/paper/README
tests/README
```

```{toctree}
:hidden:
:caption: Development

CONTRIBUTING
docker/README
CHANGELOG
```
"""


def completed(app: Any, page: str, source: list[str]) -> None:
    """Add the table of contents to the first page; a link to a package leads to its docstring."""
    folder = (Path(app.srcdir) / page).parent

    def to_docstring(link: re.Match[str]) -> str:
        file = f"{link[1]}/__init__.py"
        return f"]({file})" if (folder / file).exists() else link[0]

    source[0] = re.sub(r"\]\(([\w./]+)\)", to_docstring, source[0])
    if page == root_doc:
        source[0] += TABLE_OF_CONTENTS


def shortened(*event: Any) -> tuple[str | None, ...]:
    """Write the array type of a signature by its short name everywhere."""
    return tuple(
        text and re.sub(r"TypeAliasForwardRef\('(\w+)'\)", r"\1", text) for text in event[-2:]
    )


def write_formula(writer: Any, node: Any) -> None:
    """Write a formula as MathML, which browsers show without a script."""
    display = "inline" if node.tagname == "math" else "block"
    writer.body.append(convert(node.astext(), display=display))
    raise SkipNode


def setup(app: Any) -> None:
    """Register the functions above."""
    app.connect("source-read", completed)
    app.connect("autodoc-process-signature", shortened)
    app.add_html_math_renderer("mathml", (write_formula, None), (write_formula, None))
