"""Forms and expressions, compiled with vectorised loops.

The loops over the basis functions of a cell are short sums. A compiler vectorises them only if it
may change the order of the additions. Infinities and numbers that are not defined keep their rules,
by which diverging iterations are recognised. The code suits every processor of an architecture, so
that computers may share a cache.
"""

from typing import Any

import numpy.typing as npt
import ufl
from dolfinx import fem

VECTORISED = ("-fno-math-errno", "-fno-trapping-math", "-fno-signed-zeros", "-fassociative-math")
"""Options of the C compiler that let it reorder sums."""

OPTIONS = {"cffi_extra_compile_args": ["-O3", "-g0", *VECTORISED], "timeout": 60}
"""How forms are compiled; the timeout in s is for another process that compiles the same form."""


def compiled_form(form: ufl.Form) -> fem.Form:
    """Compile a form. Collective."""
    return fem.form(form, jit_options=OPTIONS)


def compiled_expression(expression: Any, points: npt.ArrayLike) -> fem.Expression:
    """Compile an expression at points (k, d) of the reference cell. Collective."""
    return fem.Expression(expression, points, jit_options=OPTIONS)
