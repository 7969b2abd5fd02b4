"""Hashes of the sources that decide results and machine code. Docstrings, comments and layout do not count.

A better sentence must neither make old results unusable nor compile kernels again; any change of code must do both.
The hashes are of syntax trees, which take half a second to make: they are kept in the cache, under a hash of the bytes.
"""

from __future__ import annotations

import ast
import hashlib
import os
import tempfile
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cache
from importlib.metadata import version
from pathlib import Path

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
    """Where compiled kernels are kept: NUMBA_CACHE_DIR if set, else the user's cache, else a temporary folder."""
    if chosen := os.environ.get("NUMBA_CACHE_DIR"):
        return Path(chosen)
    temporary = Path(tempfile.gettempdir()) / f"tripod_doe-{os.getuid()}"
    candidate = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "tripod_doe"
    try:
        candidate.mkdir(parents=True, exist_ok=True)
    except OSError:
        return temporary
    return candidate if os.access(candidate, os.W_OK) else temporary


@cache
def source_hashes() -> SourceHashes:
    """The hashes of this installation."""
    raw = _digest((path.as_posix().encode() + path.read_bytes()) for path in _modules(_PACKAGE))
    kept = cache_root() / "sources" / raw
    try:
        results, kernels = kept.read_text().split()
        return SourceHashes(results, kernels)
    except (OSError, ValueError):
        hashes = hash_sources(_PACKAGE)
    try:
        kept.parent.mkdir(parents=True, exist_ok=True)
        fresh = kept.with_suffix(f".{os.getpid()}")
        fresh.write_text(f"{hashes.results} {hashes.kernels}")
        fresh.replace(kept)
    except OSError:  # a cache that cannot be written costs half a second, and nothing else
        pass
    return hashes


def hash_sources(package: Path) -> SourceHashes:
    """Hash the sources of a copy of this package.

    Parameters
    ----------
    package
        Folder of the package, ``.../tripod_doe``.
    """
    trees = _Trees()
    decide = [path for path in _modules(package) if path.relative_to(package).parts[0] in _DECIDE_RESULTS]
    waiting = [path for path in decide if _has_kernels(trees[path])]
    kernels: set[Path] = set()
    while waiting:  # numba compiles the values of globals in, so all that a kernel's module imports counts
        path = waiting.pop()
        if path not in kernels:
            kernels.add(path)
            waiting += _imported(package, trees[path])
    return SourceHashes(*(_digest(_codes(package, trees, paths)) for paths in (decide, sorted(kernels))))


class _Trees(dict[Path, ast.Module]):
    """Syntax trees without docstrings, made when they are asked for."""

    def __missing__(self, path: Path) -> ast.Module:
        self[path] = tree = ast.parse(path.read_bytes())
        _drop_docstrings(tree)
        return tree


def _modules(package: Path) -> list[Path]:
    return sorted(package.rglob("*.py"))


def _digest(parts: Iterable[bytes]) -> str:
    digest = hashlib.sha256(f"numba {version('numba')} numpy {version('numpy')}".encode())
    for part in parts:
        digest.update(part)
    return digest.hexdigest()[:16]


def _codes(package: Path, trees: _Trees, paths: Iterable[Path]) -> Iterator[bytes]:
    for path in paths:
        yield path.relative_to(package).as_posix().encode()
        yield ast.dump(trees[path]).encode()


def _drop_docstrings(node: ast.Module | ast.ClassDef | ast.FunctionDef) -> None:
    """Take every text that stands alone out of a module, its classes and their functions."""
    node.body = [line for line in node.body if not _is_text(line)]
    for inner in node.body:
        if isinstance(inner, ast.ClassDef | ast.FunctionDef):
            _drop_docstrings(inner)


def _is_text(line: ast.stmt) -> bool:
    return isinstance(line, ast.Expr) and isinstance(line.value, ast.Constant) and isinstance(line.value.value, str)


def _has_kernels(tree: ast.Module) -> bool:
    functions = [node for node in tree.body if isinstance(node, ast.FunctionDef)]
    names = {name.id for node in functions for name in node.decorator_list if isinstance(name, ast.Name)}
    return not names.isdisjoint(_KERNEL_DECORATORS)


def _imported(package: Path, tree: ast.Module) -> Iterator[Path]:
    """Modules of the package that a module imports from."""
    for node in tree.body:
        if isinstance(node, ast.ImportFrom) and node.module and node.module.partition(".")[0] == package.name:
            place = package.joinpath(*node.module.split(".")[1:])
            candidates = [place.with_name(f"{place.name}.py"), place / "__init__.py"]
            candidates += [place / f"{name.name}.py" for name in node.names]
            yield from (path for path in candidates if path.exists())
