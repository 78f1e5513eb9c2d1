"""Named tuples that compiled code passes on by reference.

Numba passes a tuple by value: every call of a function moves each pointer, size and stride of each
array in it, some hundred numbers for the state of a time integration, and counts a reference to
each array. Here compiled code gets a pointer to the tuple. A field is loaded where it is used. Two
facts make these loads cheap:

- Nothing writes into a tuple (only into the arrays that it holds). Its loads are therefore marked
  as invariant, so that LLVM keeps them in registers and moves them out of loops.
- The caller keeps the arrays alive. A loaded array therefore has no owner, and no references to it
  are counted.

Source: numba's low-level extension interface (numba documentation, "Extending Numba"), and
"invariant.load" of LLVM's language reference.
"""

from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.imputils import impl_ret_borrowed
from numba.core.typing.templates import AttributeTemplate
from numba.extending import (
    infer_getattr,
    intrinsic,
    lower_getattr_generic,
    models,
    register_model,
)

OWNERS = ("meminfo", "parent")
"""Fields of an array in compiled code that name its owner."""


class TupleReference(types.Type):  # type: ignore[misc]
    """The type of a pointer to a named tuple, whose arrays have no owner."""

    def __init__(self, value: Any):
        """A reference to a tuple of this type."""
        self.value = value
        super().__init__(f"reference({value})")

    @property
    def instance_class(self) -> Any:
        """The class of the named tuple."""
        return self.value.instance_class


def _holds_arrays(kind: Any) -> bool:
    """Whether a value of this type is an array, or a tuple with an array in it."""
    if isinstance(kind, types.BaseTuple):
        return any(map(_holds_arrays, kind))
    return isinstance(kind, types.Array)


def referenced(kind: Any) -> Any:
    """The type by which compiled code holds a value of this type."""
    refers = isinstance(kind, types.BaseNamedTuple) and _holds_arrays(kind)
    return TupleReference(kind) if refers else kind


@register_model(TupleReference)
class _Pointer(models.PrimitiveModel):  # type: ignore[misc]
    """The pointer in memory."""

    def __init__(self, manager: Any, kind: Any):
        super().__init__(manager, kind, manager[kind.value].get_value_type().as_pointer())


@infer_getattr
class _Fields(AttributeTemplate):  # type: ignore[misc]
    """The types of the fields of a reference."""

    key = TupleReference

    def generic_resolve(self, reference: Any, name: str) -> Any:
        """The type of a field; None if the tuple has no such field."""
        fields = reference.value.fields
        return referenced(reference.value[fields.index(name)]) if name in fields else None


@lower_getattr_generic(TupleReference)
def _field(context, builder, kind, pointer, name):  # type: ignore[no-untyped-def]
    """A field: the place of a named tuple, or a value loaded from its place."""
    number = kind.value.fields.index(name)
    field, place = kind.value[number], cgutils.gep_inbounds(builder, pointer, 0, number)
    if isinstance(referenced(field), TupleReference):
        return place
    return _load(context, builder, field, place)


def _load(context: Any, builder: Any, kind: Any, place: Any) -> Any:
    """Load a value from its place, number by number; the owner of an array is nobody."""
    if not isinstance(kind, types.Array | types.BaseTuple):
        return _load_number(builder, place)
    if isinstance(kind, types.BaseTuple):
        members = [
            _load(context, builder, member, cgutils.gep_inbounds(builder, place, 0, number))
            for number, member in enumerate(kind)
        ]
        return context.make_tuple(builder, kind, members)
    array = context.make_array(kind)(context, builder)
    for number, name in enumerate(context.data_model_manager[kind]._fields):
        part = cgutils.gep_inbounds(builder, place, 0, number)
        if name in OWNERS:
            value = cgutils.get_null_value(part.type.pointee)
        elif name in ("shape", "strides"):
            sizes = [cgutils.gep_inbounds(builder, part, 0, axis) for axis in range(kind.ndim)]
            value = cgutils.pack_array(builder, [_load_number(builder, size) for size in sizes])
        else:
            value = _load_number(builder, part)
        setattr(array, name, value)
    return array._getvalue()


def _load_number(builder: Any, place: Any) -> Any:
    """Load a number, or a pointer, from memory that nothing writes to."""
    loaded = builder.load(place)
    loaded.set_metadata("invariant.load", builder.module.add_metadata([]))
    return loaded


def _store(builder: Any, value: Any, place: Any) -> None:
    """Store a value, number by number, as LLVM is slow on stores of whole tuples."""
    if not isinstance(value.type, ir.Aggregate):
        builder.store(value, place)
        return
    for number in range(len(value.type)):
        member = builder.extract_value(value, number)
        _store(builder, member, cgutils.gep_inbounds(builder, place, 0, number))


def _refer(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    """A value as compiled code holds it: a named tuple in the memory of the calling function.

    The empty assembly hides from the optimiser that this memory was written to. The loads that are
    marked as invariant might otherwise be moved before it.
    """
    if not isinstance(referenced(kind), TupleReference):
        return value
    place = cgutils.alloca_once(builder, value.type)
    _store(builder, value, place)
    kind = ir.FunctionType(place.type, [place.type])
    hidden = ir.InlineAsm(kind, "", "=r,0,~{memory}", side_effect=True)
    return builder.call(hidden, [place])


@intrinsic
def borrow(typing_context, values):  # type: ignore[no-untyped-def]
    """The members of a tuple; of each named tuple a reference, valid until the caller returns."""
    kind = types.Tuple([referenced(member) for member in values])

    def code(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        members = [
            _refer(context, builder, member, builder.extract_value(arguments[0], number))
            for number, member in enumerate(values)
        ]
        return impl_ret_borrowed(context, builder, kind, context.make_tuple(builder, kind, members))

    return kind(values), code
