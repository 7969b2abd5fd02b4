"""Sources of a study's function: its module, and the modules that it imports from the same folder.

They are found by reading import statements, also those within functions, so that the answer does not depend on what a
process has imported so far. Installed packages that it imports, and files that it reads by itself, do not count.
"""

import ast
import hashlib
import inspect
import pickle
import sys
import sysconfig
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import lru_cache
from itertools import chain
from pathlib import Path
from types import BuiltinFunctionType, CodeType, FunctionType, ModuleType
from typing import Any

_INSTALLED = {"site-packages", "dist-packages"}
_PLAIN = (int, float, complex, str, bytes, type(None))
_NAMED = (ModuleType, type, FunctionType, BuiltinFunctionType)
_OF_CLASSES = ("__dict__", "__weakref__", "__module__", "__doc__", "__firstlineno__")


def sources_of(module: str) -> dict[str, bytes]:
    """The files of a loaded module and of all that it imports from its folder, by their paths below that folder.

    Of an installed package the module alone; nothing of a module without a file, as those of a notebook.
    """
    file = getattr(sys.modules[module], "__file__", None)
    if not file or not Path(file).is_file():
        return {}
    own, place, root = Path(file), module.replace(".", "/"), import_root(module, file)
    if place == "__main__" or _is_installed(root):
        return {place: own.read_bytes()}
    found: dict[str, bytes] = {}
    waiting = [module]
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


def module_paths(name: str) -> tuple[str, str]:
    """The paths that a module may have below the folder from which it is imported: of a package, of a single file."""
    stem = name.replace(".", "/")
    return f"{stem}/__init__.py", f"{stem}.py"


def module_names(paths: Iterable[str]) -> set[str]:
    """The names under which modules are imported, from their paths."""
    return {path.removesuffix(".py").removesuffix("/__init__").replace("/", ".") for path in paths}


def source_hash(function: Callable[..., Any], sources: Mapping[str, bytes]) -> str:
    """A hash of 16 hex digits over the code of a function; comments and layout do not count.

    Args:
        sources: As `sources_of` gives them; where there are none, as in a notebook, the instructions of the function
            count, and the values, functions and files that it uses.
    """
    digest = hashlib.blake2b(digest_size=8)
    for path in sorted(sources):
        digest.update(path.encode() + b"\0" + _code(sources[path]))
    for part in () if sources else _used(function, {}):
        digest.update(part + b"\0")
    return digest.hexdigest()


def _used(value: Any, seen: dict[int, int]) -> Iterator[bytes]:
    """What a value contributes to the results of a function without a file: code, values, files; never line numbers.

    Args:
        seen: Numbers of the values so far, by their identity.
    """
    if isinstance(value, _PLAIN):
        yield repr((type(value), value)).encode()
        return
    if id(value) in seen:
        yield b"%d" % seen[id(value)]
        return
    seen[id(value)] = len(seen)
    module = value.__name__ if isinstance(value, ModuleType) else getattr(value, "__module__", None) or ""
    file = getattr(sys.modules.get(module), "__file__", None) or ""
    function = inspect.unwrap(getattr(value, "py_func", value)) if callable(value) else value  # numba keeps it there
    parts: Iterable[Any] = ()
    if isinstance(value, _NAMED) and (module != "__main__" or Path(file).is_file()):
        yield f"{module} {getattr(value, '__qualname__', '')}".encode()
        if Path(file).is_file() and not _is_installed(import_root(module, file)):
            yield from (part for path, text in sorted(sources_of(module).items()) for part in (path.encode(), text))
    elif isinstance(function, FunctionType):
        yield from _used_in(function.__code__, function.__globals__, seen)
        cells = (cell.cell_contents for cell in function.__closure__ or ())
        parts = chain(function.__defaults__ or (), *(function.__kwdefaults__ or {}).items(), cells)
    elif isinstance(value, list | tuple | set | frozenset):
        yield type(value).__name__.encode()
        parts = sorted(value, key=repr) if isinstance(value, set | frozenset) else value
    elif isinstance(value, dict | type):
        own = vars(value) if isinstance(value, type) else value
        parts = chain(*(each for each in own.items() if isinstance(value, dict) or each[0] not in _OF_CLASSES))
    else:
        parts = [type(value)]
        try:
            yield pickle.dumps(value)
        except Exception as error:  # whatever an object of the user raises
            yield type(error).__name__.encode()
    for part in parts:
        yield from _used(part, seen)


def _used_in(code: CodeType, known: Mapping[str, Any], seen: dict[int, int]) -> Iterator[bytes]:
    """Instructions, and what they use of the names of their module."""
    yield code.co_code
    yield repr((code.co_names, code.co_varnames, code.co_freevars, code.co_flags)).encode()
    for each in code.co_consts:
        yield from _used_in(each, known, seen) if isinstance(each, CodeType) else (repr(each).encode(),)
    for name in code.co_names:
        if name in known:
            yield name.encode()
            yield from _used(known[name], seen)


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
