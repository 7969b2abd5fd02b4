"""Sources of a study's function: its module, and the modules that it imports from the same folder.

They are found by reading imports, also those within functions, so that the answer does not depend on what a process has
imported so far. Installed packages that it imports, and files that it reads by itself, do not count.
"""

import ast
import hashlib
import sys
import sysconfig
from collections.abc import Iterator, Mapping
from functools import lru_cache
from importlib.machinery import EXTENSION_SUFFIXES
from pathlib import Path

_ENDINGS = (".py", *EXTENSION_SUFFIXES)
_INSTALLED = {"site-packages", "dist-packages"}


def sources_of(module: str) -> dict[str, bytes]:
    """The files of a loaded module and of all that it imports from its folder, by their paths below that folder.

    Of an installed package the module alone; nothing of a module without a file, as in a notebook, nor of a script in
    an interactive session, which may define its functions anew. A script has the path ``__main__``.
    """
    loaded = sys.modules[module]
    file = getattr(loaded, "__file__", None)
    if not file or not Path(file).is_file() or (module == "__main__" and sys.flags.inspect):
        return {}
    own, place, root = Path(file), module.replace(".", "/"), import_root(module, file)
    if _is_installed(root):
        return {place: own.read_bytes()}
    found: dict[str, bytes] = {}
    waiting = [module]
    if place == "__main__":
        package = loaded.__package__ or ""  # of python -m package.module
        root = own.parents[len(package.split(".")) if package else 0]
        found[place] = own.read_bytes()
        waiting = list(_imported(found[place], package))
    while waiting:
        name = waiting.pop()
        for path in module_paths(name):
            if path not in found and (root / path).is_file():
                found[path] = (root / path).read_bytes()
                package = name if path.endswith("__init__.py") else name.rpartition(".")[0]
                waiting += [*_imported(found[path], package), *([package] if package else [])]
    return found or {place: own.read_bytes()}


def _is_installed(root: Path) -> bool:
    return bool(_INSTALLED & set(root.parts)) or root.is_relative_to(sysconfig.get_path("stdlib"))


def import_root(module: str, file: str) -> Path:
    """The folder from which a module is imported, whose file is known."""
    return Path(file).parents[module.count(".") + (Path(file).name == "__init__.py")]


def module_paths(name: str) -> list[str]:
    """The paths that a module may have below the folder from which it is imported: of a package, of a single file."""
    stem = name.replace(".", "/")
    return [f"{stem}/__init__.py", *(f"{stem}{ending}" for ending in _ENDINGS)]


def module_name(path: str) -> str:
    """The name under which a module is imported, from its path."""
    return path.partition(".")[0].removesuffix("/__init__").replace("/", ".")


def stays_loaded(path: str) -> bool:
    """Whether Python keeps a module until it ends, whatever its file becomes: a compiled one."""
    return not path.endswith(".py")


def source_hash(sources: Mapping[str, bytes]) -> str:
    """A hash of 16 hex digits over code, as `sources_of` gives it; comments and layout do not count. Empty without."""
    digest = hashlib.blake2b(digest_size=8)
    for path in sorted(sources):
        digest.update(path.encode() + b"\0" + _code(sources[path]))
    return digest.hexdigest() if sources else ""


@lru_cache(maxsize=1000)
def _code(text: bytes) -> bytes:
    """The syntax tree of a module; of an extension module, or of one that is not complete yet, its bytes."""
    try:
        return ast.dump(ast.parse(text)).encode()
    except (SyntaxError, ValueError):
        return text


@lru_cache(maxsize=1000)
def _imported(text: bytes, package: str) -> tuple[str, ...]:
    """Names that may be modules, of all imports of a module."""
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
    elif isinstance(node, ast.Call):
        match node:
            case ast.Call(
                func=ast.Attribute(attr="import_module") | ast.Name(id="import_module" | "__import__"),
                args=[ast.Constant(value=str() as name), *_],
            ):
                yield name
