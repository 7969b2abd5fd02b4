"""Arrays by name that kernels get as one pointer.

numba passes a named tuple by value: with the tables and the work memory of a scene every call between kernels had 430
arguments, whose handling took two thirds of all compile time. The fields of a `ByReference` are laid out once in the
memory of this process, as numba lays out its arrays; kernels pass on only the address.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from functools import cache
from typing import Any

import numpy as np
from llvmlite import ir
from numba import typeof
from numba.core import types
from numba.core.typing.templates import AttributeTemplate, infer_getattr
from numba.extending import NativeValue, lower_getattr_generic, models, register_model, typeof_impl, unbox

_WORD = ir.IntType(64)


class ByReference:
    """Base of frozen dataclasses of contiguous arrays, integers and others of their kind, which kernels can read.

    Kernels write into the arrays; the fields themselves never change.
    """

    def __post_init__(self) -> None:
        words = np.array(list(_layout(self)), np.int64)
        object.__setattr__(self, "_words", words)
        object.__setattr__(self, "_address", words.ctypes.data)
        object.__setattr__(self, "_numba_type_", _reference_to(self))

    def __reduce__(self) -> tuple[Any, ...]:
        """Copies, and other processes, create their own layout."""
        return type(self), tuple(value for _, value in _fields(self))


def _fields(bundle: Any) -> Iterator[tuple[str, Any]]:
    return ((field.name, getattr(bundle, field.name)) for field in dataclasses.fields(bundle))


def _layout(bundle: Any) -> Iterator[int]:
    """The fields as words of eight bytes: of an array no owner, sizes, address, shape and strides."""
    for name, value in _fields(bundle):
        if isinstance(value, ByReference):
            yield from _layout(value)
        elif isinstance(value, np.ndarray):
            if not value.flags.c_contiguous:
                raise ValueError(f"{name}: not contiguous")
            yield from (0, 0, value.size, value.itemsize, value.ctypes.data, *value.shape, *value.strides)
        else:
            yield int(value)


class _Reference(types.Type):
    """Type of a pointer to fields of these names and types."""

    def __init__(self, name: str, fields: tuple[tuple[str, types.Type], ...]) -> None:
        self.fields = fields
        super().__init__(name=name)

    @property
    def key(self) -> tuple[Any, ...]:
        """The key by which numba compares types."""
        return self.name, self.fields


def _reference_to(bundle: ByReference) -> _Reference:
    return _reference(type(bundle), tuple(_kind_of(value) for _, value in _fields(bundle)))  # type: ignore[arg-type]


def _kind_of(value: Any) -> Any:
    """What decides the type of a field, which costs less to find than the type."""
    if isinstance(value, np.ndarray):
        return value.dtype, value.ndim, value.flags.writeable
    return int if isinstance(value, int) else typeof(value)


@cache
def _reference(bundle: type[ByReference], kinds: tuple[Any, ...]) -> _Reference:
    """Type of a pointer to such a bundle, made once: numba would look through all fields of all arrays each time."""
    names = (field.name for field in dataclasses.fields(bundle))  # type: ignore[arg-type]
    return _Reference(bundle.__name__, tuple((name, _type_of(kind)) for name, kind in zip(names, kinds, strict=True)))


def _type_of(kind: Any) -> types.Type:
    if kind is int:
        return types.int64
    if not isinstance(kind, tuple):
        return kind
    dtype, dimensions, writeable = kind
    example = np.empty((1,) * dimensions, dtype)
    example.flags.writeable = writeable
    return typeof(example)


def _words_of(kind: types.Type) -> int:
    if isinstance(kind, _Reference):
        return sum(_words_of(field) for _, field in kind.fields)
    return 5 + 2 * kind.ndim if isinstance(kind, types.Array) else 1


@typeof_impl.register(ByReference)
def _(value: Any, _: Any) -> _Reference:
    kind: _Reference = value._numba_type_
    return kind


@register_model(_Reference)
class _ReferenceModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _WORD.as_pointer())


@unbox(_Reference)
def _unbox(kind: Any, value: Any, c: Any) -> NativeValue:
    address = c.pyapi.object_getattr_string(value, "_address")
    pointer = c.pyapi.long_as_voidptr(address)
    c.pyapi.decref(address)
    return NativeValue(c.builder.bitcast(pointer, _WORD.as_pointer()))


@infer_getattr
class _FieldTypes(AttributeTemplate):
    key = _Reference

    def generic_resolve(self, kind: Any, name: str) -> Any:
        """Find the type of a field; None if there is no such field."""
        return dict(kind.fields).get(name)


@lower_getattr_generic(_Reference)
def _field(context: Any, builder: Any, kind: Any, pointer: Any, name: str) -> Any:
    """Load a field; of a `_Reference` among the fields, its address."""
    place = [field for field, _ in kind.fields].index(name)
    field = kind.fields[place][1]
    start = builder.gep(pointer, [_WORD(sum(_words_of(before) for _, before in kind.fields[:place]))])
    if isinstance(field, _Reference):
        return start
    value = builder.load(builder.bitcast(start, context.get_value_type(field).as_pointer()))
    if isinstance(field, types.Array):
        # a constant says that the array has no owner: else every slice of it ends with a call that releases one, before
        # which all registers are saved (a quarter of the price of the model `rollers`)
        value = builder.insert_value(value, ir.Constant(value.type.elements[0], None), 0)
    return value
