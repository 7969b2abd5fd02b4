"""Hashes of the sources that decide results and machine code. Docstrings, comments and layout do not count.

A changed comment must neither make old results unusable nor recompile kernels; any change of code must do both.
One hash over all bytes would compile for half a minute after every changed comment. The hashes are of syntax trees,
which take half a second to make: they are kept in the cache, under a hash of the bytes.
"""

from __future__ import annotations

import ast
import hashlib
import os
import stat
import tempfile
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from importlib.metadata import version
from pathlib import Path

from tripod_doe.errors import StorageError
from tripod_doe.files.atomic_files import replace_text

_PACKAGE = Path(__file__).resolve().parents[2]
_DECIDE_RESULTS = ("mechanics", "joint")
_KERNEL_DECORATORS = {"kernel", "inlined_kernel", "inner_kernel", "kernel_part"}


@dataclass(frozen=True)
class SourceHashes:
    """Hashes of 16 hex digits, both with the versions of the compiler and of numpy."""

    results: str  # of all of mechanics and joint: results with different hashes must not be mixed
    # of the modules that contain kernels and of all that they import: names the cache of their machine code
    kernels: str


def cache_root() -> Path:
    """Folder of compiled kernels: NUMBA_CACHE_DIR if set, else the user's cache, else a temporary folder of the user.

    Machine code is loaded from it as it is, so others must not be able to write there.
    """
    if chosen := os.environ.get("NUMBA_CACHE_DIR"):
        return Path(chosen)
    candidate = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "tripod_doe"
    if _is_own_folder(candidate, stat.S_IWOTH) and os.access(candidate, os.W_OK):
        return candidate
    return _temporary_cache()


def _is_own_folder(path: Path, writable: int = stat.S_IWGRP | stat.S_IWOTH) -> bool:
    """Whether a folder, made if it is missing, belongs to this user and has none of the bits `writable`."""
    try:
        path.mkdir(mode=0o700, parents=True, exist_ok=True)
        status = path.stat(follow_symlinks=False)
    except OSError:
        return False
    return stat.S_ISDIR(status.st_mode) and status.st_uid == os.geteuid() and not status.st_mode & writable


@cache
def _temporary_cache() -> Path:
    """A temporary folder with a fixed name; if another user owns it, a new folder for these processes."""
    lasting = Path(tempfile.gettempdir()) / f"tripod_doe-{os.geteuid()}"
    if _is_own_folder(lasting):
        return lasting
    fresh = tempfile.mkdtemp(prefix="tripod_doe-")
    os.environ["NUMBA_CACHE_DIR"] = fresh  # shared with the processes that this one starts
    return Path(fresh)


@cache
def source_hashes() -> SourceHashes:
    """The hashes of this installation."""
    raw = _digest(path.as_posix().encode() + path.read_bytes() for path in _modules(_PACKAGE))
    kept = cache_root() / "sources" / raw
    try:
        return SourceHashes(*kept.read_text().split())
    except (OSError, TypeError):
        hashes = hash_sources(_PACKAGE)
    with suppress(StorageError):  # a cache that cannot be written costs half a second
        replace_text(kept, f"{hashes.results} {hashes.kernels}")
    return hashes


def hash_sources(package: Path) -> SourceHashes:
    """Hash the sources of a copy of this package, whose folder is ``.../tripod_doe``."""
    names = [path.relative_to(package).as_posix() for path in _modules(package)]
    decide = [name for name in names if name.partition("/")[0] in _DECIDE_RESULTS]
    trees = {name: _parsed(package / name) for name in decide}
    waiting, kernels = [name for name in decide if _has_kernels(trees[name])], set[str]()
    while waiting:  # kernels contain the values of globals, so every import of a kernel's module counts
        name = waiting.pop()
        if name not in kernels:
            kernels.add(name)
            if name not in trees:
                trees[name] = _parsed(package / name)
            waiting += _imported(trees[name]).intersection(names)
    return SourceHashes(*(_digest(_code(name, trees[name]) for name in chosen) for chosen in (decide, sorted(kernels))))


def _modules(package: Path) -> list[Path]:
    return sorted(package.rglob("*.py"))


def _digest(parts: Iterable[bytes]) -> str:
    digest = hashlib.sha256(f"numba {version('numba')} numpy {version('numpy')}".encode())
    for part in parts:
        digest.update(part)
    return digest.hexdigest()[:16]


def _parsed(path: Path) -> ast.Module:
    """Syntax tree of a module without docstrings and other string statements."""
    tree = ast.parse(path.read_bytes())
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef):
            node.body = [line for line in node.body if not _is_text(line)]
    return tree


def _code(name: str, tree: ast.Module) -> bytes:
    return name.encode() + ast.dump(tree).encode()


def _is_text(line: ast.stmt) -> bool:
    return isinstance(line, ast.Expr) and isinstance(line.value, ast.Constant) and isinstance(line.value.value, str)


def _has_kernels(tree: ast.Module) -> bool:
    functions = [node for node in tree.body if isinstance(node, ast.FunctionDef)]
    names = {name.id for node in functions for name in node.decorator_list if isinstance(name, ast.Name)}
    return not names.isdisjoint(_KERNEL_DECORATORS)


def _imported(tree: ast.Module) -> set[str]:
    """Files that a module may import from, relative to the package."""
    files = set()
    for node in tree.body:
        if isinstance(node, ast.ImportFrom) and node.module:
            place = "/".join(node.module.split(".")[1:])
            files |= {f"{place}.py", f"{place}/__init__.py", *(f"{place}/{name.name}.py" for name in node.names)}
    return files
