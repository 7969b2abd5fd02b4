"""What kernels use of numba and llvmlite beyond their documented interfaces, which a later version may lack.

The versions that pyproject.toml allows were tried. With another one, which only an installation by hand can bring, a
missing part would end in a traceback from somewhere within numba: it is looked for first.
"""

from __future__ import annotations

import re
from importlib import import_module
from importlib.metadata import version

from tripod_doe.errors import InputError

TRIED = ">=0.61,<0.69"
"""Versions of numba, as pyproject.toml writes them."""

_FIRST, _BEYOND = ([int(number) for number in re.findall(r"\d+", bound)] for bound in TRIED.split(","))

PARTS = {
    "llvmlite.ir": ("Constant", "DoubleType", "FunctionType", "IntType", "Undefined", "VectorType"),
    "numba": ("jit", "njit", "typeof"),
    "numba.core": ("cgutils", "event", "types"),
    "numba.core.caching": ("CacheImpl",),
    "numba.core.caching.CacheImpl": ("_locator_classes",),
    "numba.core.cpu.CPUTargetOptions": ("forceinline", "no_cfunc_wrapper", "no_cpython_wrapper"),
    "numba.core.event": ("RecordingListener", "install_listener"),
    "numba.core.registry": ("CPUDispatcher",),
    "numba.core.typing.templates": (
        "AttributeTemplate",
        "ConcreteTemplate",
        "infer_getattr",
        "infer_global",
        "signature",
    ),
    "numba.extending": (
        "NativeValue",
        "intrinsic",
        "lower_builtin",
        "lower_getattr_generic",
        "models",
        "register_model",
        "typeof_impl",
        "unbox",
    ),
}
"""Names that are used, by the module or class that has them."""


def check_numba() -> None:
    """Look for all parts where the installed version of numba was not tried.

    Raises
    ------
    InputError
        If one is missing; it names the versions that have all of them.
    """
    installed = version("numba")
    if _FIRST <= [int(number) for number in re.findall(r"\d+", installed)[:2]] < _BEYOND:
        return
    missing = [f"{owner}.{name}" for owner, names in PARTS.items() for name in names if not _has(owner, name)]
    if missing:
        raise InputError(
            f"numba {installed} lacks {', '.join(missing)}, which the kernels of this tripod-doe use; "
            f"install a version that was tried: python3 -m pip install 'numba{TRIED}'"
        )


def _has(owner: str, name: str) -> bool:
    """Whether a module, or a class in one, has a name."""
    try:
        return hasattr(import_module(owner), name)
    except ModuleNotFoundError:
        module, _, inner = owner.rpartition(".")
        return bool(module) and _has(module, inner) and hasattr(getattr(import_module(module), inner), name)
