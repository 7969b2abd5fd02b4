"""Compilation of kernels: one decorator, and a disk cache that every change of a kernel source renews.

numba's cache checks only the file that defines a kernel: a change in an imported file leaves stale machine code, and a
changed comment compiles the whole file again. Here a hash of the code of all modules with kernels (`sources`) names the
folder; line numbers and installation path have no influence.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from functools import cached_property
from pathlib import Path
from types import FunctionType
from typing import Any

import numba
from numba.core.caching import CacheImpl
from numba.core.registry import CPUDispatcher

from tripod_doe.mechanics.compilation.sources import cache_root, source_hashes

_PACKAGE = Path(__file__).resolve().parents[2]
_MARK = "is_kernel"


class KernelLocator:
    """Folder of the machine code of kernels; numba asks other locators for other functions.

    Kernels of other files, such as benchmarks, contain kernels of this package. Their folders stand within this
    package's folder, each named by the text of its file.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    @classmethod
    def from_function(cls, function: Callable[..., Any], file: str) -> KernelLocator | None:
        """A locator for a kernel; None for any other function, or if the folder cannot be written."""
        path = Path(file).resolve()
        try:
            if path.is_relative_to(_PACKAGE):
                place = path.relative_to(_PACKAGE).parent
            elif _MARK in vars(function):
                place = Path("other", hashlib.sha256(path.read_bytes()).hexdigest()[:16])
            else:
                return None
            locator = cls(cache_root() / f"kernels-{source_hashes().kernels}" / place)
            locator.ensure_cache_path()
        except OSError:
            return None
        return locator

    def ensure_cache_path(self) -> None:
        """Make the folder."""
        self._folder.mkdir(parents=True, exist_ok=True)

    def get_cache_path(self) -> str:
        """The folder."""
        return str(self._folder)

    def get_source_stamp(self) -> str:
        """Stamp of the source: constant, because the folder's name contains the hash."""
        return ""

    def get_disambiguator(self) -> str:
        """Module and name only: numba would add the line number."""
        return "kernel"


CacheImpl._locator_classes.insert(0, KernelLocator)


_OPTIONS = {"nopython": True, "nogil": True, "error_model": "numpy"}
"""Division by zero gives inf or nan as in numpy: the branch that raises an exception would keep loops from being
vectorised. No fast-math: it gains at most a tenth and breaks the guards against NaN."""


def kernel(function: Callable[..., Any]) -> Any:
    """Compile a module-level function to machine code, cached on disk, releasing the interpreter lock."""
    vars(function)[_MARK] = True
    return numba.jit(cache=True, **_OPTIONS)(function)


def kernel_part(function: Callable[..., Any]) -> Any:
    """Make a function a part of the kernels that call it: it is compiled with them, as if it were written there.

    For large functions with one or two callers. A kernel that others call is compiled alone, again in each caller, and
    again in their callers: this took a sixth of all compile time.
    """
    return numba.jit(cache=True, inline="always", **_OPTIONS)(function)


class _Inner(CPUDispatcher):  # type: ignore[misc]
    """A compiled function for kernels, without Python entry and cache, which took most of its compile time."""

    def __call__(self, *arguments: Any) -> Any:
        """Call it from Python, as tests do, through a function with a Python entry."""
        return self._entry(*arguments)

    @cached_property
    def _entry(self) -> Callable[..., Any]:
        called: FunctionType = self.py_func
        entry = FunctionType(_enter.__code__, {"inner": self, "__name__": __name__})
        entry.__qualname__ = f"{called.__module__}.{called.__qualname__}"  # names its file in the cache
        compiled: Callable[..., Any] = kernel(entry)
        return compiled


def _enter(*arguments: Any) -> Any:
    return inner(*arguments)  # type: ignore[name-defined] # noqa: F821 # a global of each entry, as closures are not cached


_INNER = _OPTIONS | {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}


def inner_kernel(function: Callable[..., Any]) -> Any:
    """Compile a function that only kernels call, in several places."""
    return _Inner(py_func=function, targetoptions=_INNER)


def inlined_kernel(function: Callable[..., Any]) -> Any:
    """Compile a scalar law or formula that is always inlined, so that the loops that call it are vectorised."""
    return _Inner(py_func=function, targetoptions=_INNER | {"forceinline": True})
