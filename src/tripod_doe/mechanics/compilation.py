"""Compilation of kernels: one decorator, and a disk cache that notices every change of a kernel source.

numba's own cache looks only at the file a kernel stands in: a change in an imported file leaves stale machine code
behind. The cache directory is therefore named by a hash of all kernel sources, and that hash goes into every cube.
"""

from __future__ import annotations

import hashlib
import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
import numpy as np

__all__ = ["inlined_kernel", "kernel", "kernel_source_hash"]

_PACKAGE = Path(__file__).resolve().parent.parent


def kernel_source_hash() -> str:
    """Hash of all sources that kernels are compiled from, and of the compiler's version (16 hex digits)."""
    digest = hashlib.sha256(f"numba {numba.__version__} numpy {np.__version__}".encode())
    for folder in ("mechanics", "joint"):
        for path in sorted((_PACKAGE / folder).rglob("*.py")):
            digest.update(path.relative_to(_PACKAGE).as_posix().encode())
            digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def _cache_root() -> Path:
    """Where compiled kernels are kept: NUMBA_CACHE_DIR if set, else the user's cache, else a temporary folder."""
    if chosen := os.environ.get("NUMBA_CACHE_DIR"):
        return Path(chosen)
    home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    candidate = home / "tripod_doe"
    try:
        candidate.mkdir(parents=True, exist_ok=True)
    except OSError:
        return Path(tempfile.gettempdir()) / f"tripod_doe-{os.getuid()}"
    return candidate if os.access(candidate, os.W_OK) else Path(tempfile.gettempdir()) / f"tripod_doe-{os.getuid()}"


KERNEL_SOURCE_HASH = kernel_source_hash()
numba.config.CACHE_DIR = str(_cache_root() / f"kernels-{KERNEL_SOURCE_HASH}")


def kernel(function: Callable[..., Any]) -> Any:
    """Compile a module-level function to machine code, cached on disk, releasing the interpreter lock.

    Division by zero gives inf or nan as in numpy: the branch that raises an exception would keep loops from being
    vectorised. No fast-math: it gains at most a tenth and breaks the guards against NaN.
    """
    return numba.njit(cache=True, nogil=True, error_model="numpy")(function)


def inlined_kernel(function: Callable[..., Any]) -> Any:
    """Compile a scalar law or formula that is always inlined, so that the loops that call it are vectorised."""
    return numba.njit(cache=True, nogil=True, error_model="numpy", forceinline=True)(function)
