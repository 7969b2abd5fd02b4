"""Sources of a study's function: its module, and the modules that it imports from the same folder.

They are found by reading imports, also those within functions, so that the answer does not depend on what a process has
imported so far. Installed packages that it imports, and files that it reads by itself, do not count.
"""

import ast
import copyreg
import hashlib
import pickle
import sys
import sysconfig
import weakref
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import lru_cache
from importlib.machinery import EXTENSION_SUFFIXES
from itertools import chain
from pathlib import Path
from types import BuiltinFunctionType, CodeType, FunctionType, MappingProxyType, MethodType, ModuleType
from typing import Any

_ENDINGS = (".py", *EXTENSION_SUFFIXES)
_INSTALLED = {"site-packages", "dist-packages"}
_PLAIN = (int, float, complex, str, bytes, type(None), type(...))
_NAMED = (ModuleType, type, FunctionType, BuiltinFunctionType)
_INNER = ("__wrapped__", "__func__", "fget", "fset", "fdel")  # of cached and static functions, and of properties
_CACHES = (weakref.WeakKeyDictionary, weakref.WeakValueDictionary)
_OF_CLASSES = ("__dict__", "__weakref__", "__module__", "__doc__", "__firstlineno__")


def sources_of(module: str) -> dict[str, bytes]:
    """The files of a loaded module and of all that it imports from its folder, by their paths below that folder.

    Of an installed package the module alone; nothing of a module without a file, as those of a notebook. A program that
    is run as a script has the path ``__main__``.
    """
    loaded = sys.modules[module]
    file = getattr(loaded, "__file__", None)
    if not file or not Path(file).is_file():
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


def module_names(paths: Iterable[str]) -> set[str]:
    """The names under which modules are imported, from their paths."""
    return {path.partition(".")[0].removesuffix("/__init__").replace("/", ".") for path in paths}


def stays_loaded(path: str) -> bool:
    """Whether Python keeps a module until it ends, whatever its file becomes: a compiled one."""
    return not path.endswith(".py")


def source_hash(function: Callable[..., Any], sources: Mapping[str, bytes]) -> str:
    """A hash of 16 hex digits over the code of a function; comments and layout do not count.

    Args:
        sources: As `sources_of` gives them; where there are none, as in a notebook, the instructions of the function
            count, and the values, functions and files that it uses.
    """
    digest = hashlib.blake2b(digest_size=8)
    for path in sorted(sources):
        digest.update(path.encode() + b"\0" + _code(sources[path]))
    for part in () if sources else _used(function):
        digest.update(part + b"\0")
    return digest.hexdigest()


def _used(function: Any) -> Iterator[bytes]:
    """What a function without a file consists of, and all that it uses: code, values, files; never line numbers."""
    seen: dict[int, tuple[int, Any]] = {}  # the values, too: the identity of one that is gone may be used again
    waiting = [function]
    while waiting:
        value = waiting.pop()
        if isinstance(value, _PLAIN):
            yield value if type(value) is bytes else repr((type(value), value)).encode()
        elif id(value) in seen:
            yield b"%d" % seen[id(value)][0]
        else:
            seen[id(value)] = len(seen), value
            words, parts = _taken_apart(value)
            yield from words
            yield b"%d" % len(parts)
            waiting += reversed(parts)


def _taken_apart(value: Any) -> tuple[list[bytes], list[Any]]:
    """What a value states itself, and the values of which it consists."""
    module = value.__name__ if isinstance(value, ModuleType) else str(getattr(value, "__module__", None) or "")
    file = getattr(sys.modules.get(module), "__file__", None) or ""
    if isinstance(value, _NAMED) and (module != "__main__" or Path(file).is_file()):
        words = [f"{module} {getattr(value, '__qualname__', '')}".encode()]
        if Path(file).is_file() and not _is_installed(import_root(module, file)):
            words += [part for path, text in sorted(sources_of(module).items()) for part in (path.encode(), text)]
        return words, _own_parts(value)
    if isinstance(value, FunctionType):
        words, parts = _of_code(value.__code__, value.__globals__)
        parts += [value.__defaults__, value.__kwdefaults__, vars(value), *_cells(value)]  # vars: what a decorator notes
        return words, parts
    if type(value) in (set, frozenset):
        return [type(value).__name__.encode()], sorted(value, key=repr)
    if type(value) in (list, tuple):
        is_plain = {*map(type, value)} <= {*_PLAIN, bool}  # a long list of numbers is fast so
        return [repr(value if is_plain else type(value)).encode()], [] if is_plain else list(value)
    if type(value) in (dict, MappingProxyType):
        return [b"dict"], list(chain(*value.items()))
    if isinstance(value, type):
        return [], [*value.__bases__, *chain(*(each for each in vars(value).items() if each[0] not in _OF_CLASSES))]
    if isinstance(value, MethodType):
        return [b"method"], [value.__self__, value.__func__]
    if compiled := getattr(value, "py_func", None) or getattr(value, "pyfunc", None):
        return [b"compiled"], [compiled]  # of numba, or vectorized: its other parts change with its use
    return _of_object(value)


def _of_object(value: Any) -> tuple[list[bytes], list[Any]]:
    """An object of any other class as `pickle` takes it apart, and the functions in it that this leaves out."""
    inner = [each for name in _INNER if (each := getattr(value, name, None)) is not None]
    if isinstance(value, _CACHES):
        return [b"cache"], []
    try:
        known = copyreg.dispatch_table.get(type(value))  # of regular expressions, for instance
        reduced = known(value) if known else value.__reduce_ex__(pickle.DEFAULT_PROTOCOL)
    except Exception as error:  # whatever an object of the user raises
        return [type(error).__name__.encode()], [type(value), *inner]
    if isinstance(reduced, str):
        return [reduced.encode()], [type(value), *inner]
    return [], [*(list(part) if isinstance(part, Iterator) else part for part in reduced), *inner]


def _own_parts(value: Any) -> list[Any]:
    """Parts that something from elsewhere has from the notebook: of a decorated function, the function in it."""
    if isinstance(value, FunctionType):
        return [each for each in _cells(value) if callable(each)]
    if isinstance(value, BuiltinFunctionType) and not isinstance(value.__self__, ModuleType | type):
        return [value.__self__]
    if isinstance(value, ModuleType) and value.__spec__ is None and value.__name__ != "__main__":  # made by hand
        return list(chain(*(each for each in vars(value).items() if not each[0].startswith("__"))))
    return []


def _cells(function: FunctionType) -> list[Any]:
    """The values that a function has from the function around it; [] for one that is not set yet."""
    values: list[Any] = []
    for cell in function.__closure__ or ():
        try:
            values.append(cell.cell_contents)
        except ValueError:
            values.append([])
    return values


def _of_code(code: CodeType, known: Mapping[str, Any]) -> tuple[list[bytes], list[Any]]:
    """Instructions, and what they use of the names of their module, each behind its name."""
    words = [code.co_code, repr((code.co_names, code.co_varnames, code.co_freevars, code.co_flags)).encode()]
    parts: list[Any] = list(chain(*((name, known[name]) for name in code.co_names if name in known)))
    for each in code.co_consts:
        inner, own = _of_code(each, known) if isinstance(each, CodeType) else ([], [each])
        words, parts = words + inner, parts + own
    return words, parts


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
