"""Sources of a study's function: its module, and the modules that it imports from the same folder.

They are found by reading import statements, also those within functions, so that the answer does not depend on what a
process has imported so far. Installed packages that it imports, and files that it reads by itself, do not count.
"""

import ast
import hashlib
import marshal
import sys
import sysconfig
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

_INSTALLED = {"site-packages", "dist-packages"}


def sources_of(module: str) -> dict[str, bytes]:
    """The files of a loaded module and of all that it imports from its folder, by their paths below that folder.

    Of an installed package the module alone; nothing of a module without a file, as those of a notebook.
    """
    file = getattr(sys.modules[module], "__file__", None)
    if not file:
        return {}
    own, place = Path(file), module.replace(".", "/")
    root = own.parents[module.count(".") + (own.name == "__init__.py")]
    if place == "__main__" or _INSTALLED & set(root.parts) or root.is_relative_to(sysconfig.get_path("stdlib")):
        return {place: own.read_bytes()}
    found: dict[str, bytes] = {}
    waiting = [module]
    while waiting:
        name = waiting.pop()
        for path in (f"{name.replace('.', '/')}/__init__.py", f"{name.replace('.', '/')}.py"):
            if path not in found and (root / path).is_file():
                found[path] = (root / path).read_bytes()
                package = name if path.endswith("__init__.py") else name.rpartition(".")[0]
                waiting += [*_imported(found[path], package), *([package] if package else [])]
    return found or {place: own.read_bytes()}


def module_names(paths: Iterable[str]) -> set[str]:
    """The names under which modules are imported, from their paths."""
    return {path.removesuffix(".py").removesuffix("/__init__").replace("/", ".") for path in paths}


def source_hash(function: Callable[..., Any], sources: Mapping[str, bytes]) -> str:
    """A hash of 16 hex digits over the code of a function; comments and layout do not count.

    Args:
        sources: As `sources_of` gives them; where there are none, the function's own instructions count.
    """
    digest = hashlib.blake2b(digest_size=8)
    for path in sorted(sources):
        digest.update(path.encode() + b"\0" + _code(sources[path]))
    if not sources and (own := getattr(function, "__code__", None)):
        digest.update(marshal.dumps(own))
    return digest.hexdigest()


@lru_cache(maxsize=1000)
def _code(text: bytes) -> bytes:
    """The syntax tree of a module; of an extension module, or of one that is not complete yet, its bytes."""
    try:
        return ast.dump(ast.parse(text)).encode()
    except (SyntaxError, ValueError):
        return text


@lru_cache(maxsize=1000)
def _imported(text: bytes, package: str) -> tuple[str, ...]:
    """Names that may be modules, of all import statements of a module."""
    try:
        tree = ast.parse(text)
    except (SyntaxError, ValueError):
        return ()
    return tuple(name for node in ast.walk(tree) for name in _names(node, package))


def _names(node: ast.AST, package: str) -> Iterator[str]:
    if isinstance(node, ast.Import):
        yield from (alias.name for alias in node.names)
    elif isinstance(node, ast.ImportFrom):
        parents = package.split(".") if package else []
        above = parents[: len(parents) - node.level + 1] if node.level else []
        base = ".".join([*above, *([node.module] if node.module else [])])
        yield base
        yield from (f"{base}.{alias.name}".lstrip(".") for alias in node.names)
