"""Simulators by name: scenes from a table, plain functions by their import path."""

import importlib
import sys
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from types import ModuleType
from typing import Any
from weakref import WeakKeyDictionary

from tripod_doe.errors import InputError, TripodDoeError, near_match
from tripod_doe.model_interface import Simulator
from tripod_doe.study.definition.function import FunctionSimulator
from tripod_doe.study.definition.function_sources import import_root, module_name, source_hash, sources_of, stays_loaded
from tripod_doe.study.definition.study_folder import StudyFolder

SCENES = {
    "joint": "tripod_doe.joint.simulator:simulator",
    "needle-between-plates": "tripod_doe.mechanics.scenes.needle_between_plates:simulator",
    "trunnion": "tripod_doe.joint.trunnion:simulator",
    "roller-in-groove": "tripod_doe.mechanics.scenes.roller_in_groove:simulator",
}
"""Scenes by the name that study files and the command line use, each ``package.module:object``."""

_latest: dict[str, tuple[StudyFolder | None, Simulator]] = {}
"""The latest import of each function, and the folder of its study."""
_loaded_for: dict[str, list[str]] = {}
"""Folders of the studies for which a module was loaded, the latest last, by the module's name."""
_sources: WeakKeyDictionary[ModuleType, dict[str, bytes]] = WeakKeyDictionary()
"""Files of each module that was loaded for a function, of a script, too, as they were then."""
_loaded: dict[str, tuple[str, bytes]] = {}
"""File and text of all modules that were loaded for functions, by their names."""


def load_simulator(scene: str = "joint", function: str | None = None, folder: StudyFolder | None = None) -> Simulator:
    """Find a scene by its name, or a function by ``package.module:function``.

    Args:
        scene: A key of `SCENES`; ignored where a function is named.
        folder: Folder of the study file, searched for the function's module first.

    Raises:
        ForbiddenError: For a function that a study from a stranger names; nothing is imported.
        InputError: If there is no such scene, module or function.
    """
    if function is None:
        if scene not in SCENES:
            raise InputError(f"scene = {scene!r}: unknown scene{near_match(scene, SCENES)}")
        module, _, name = SCENES[scene].partition(":")
        return getattr(importlib.import_module(module), name)  # a failure here is not an error of the study
    if folder:
        if (recorded := folder.recorded_function(function)) is not None:
            return recorded
        folder.refuse_functions(function)
        _search_first(str(folder.path), function.partition(":")[0].partition(".")[0])
    called, sources = _import_function(function)
    loaded = FunctionSimulator(function, called, source_hash(sources))
    _latest[function] = folder, loaded
    return loaded


def matching_simulator(scene: str, function: str | None, folder: StudyFolder | None, wanted: str) -> Simulator:
    """The simulator of a study that is running, as this process has loaded it: files may have changed meanwhile.

    Args:
        wanted: Hash of the sources in the process that plans the study.

    Raises:
        InputError: If this machine, a worker, has another version.
    """
    known, simulator = _latest.get(function or "", (None, None))
    if not simulator or known != folder or simulator.source_hash != wanted:
        simulator = load_simulator(scene, function, folder)
    if simulator.source_hash != wanted:
        if function:
            raise InputError(f"it has another version of {function}; a file may have changed since the run began")
        raise InputError("it has another version of the kernels; install the same tripod-doe on all machines")
    return simulator


def _search_first(folder: str, module: str) -> None:
    """Find a module in a folder first, also if a module of the same name was loaded for a study elsewhere."""
    sys.path[:] = [folder, *(other for other in sys.path if other != folder)]
    earlier = _loaded_for.setdefault(module, [])
    if folder in earlier[-1:]:
        return
    file = getattr(sys.modules.get(module), "__file__", None) or ""
    if any(Path(file).is_relative_to(other) for other in earlier):  # and no installed package
        _unload([name for name in sys.modules if name == module or name.startswith(f"{module}.")])
    earlier[:] = [*(other for other in earlier if other != folder), folder]


def _unload(names: Iterable[str]) -> None:
    """Forget modules, and their bytecode, which Python also uses for another text of the same size within a second."""
    for name in names:
        module = sys.modules.pop(name, None)
        if bytecode := getattr(getattr(module, "__spec__", None), "cached", None):
            with suppress(OSError):
                Path(bytecode).unlink()
    importlib.invalidate_caches()


def modules_of_scenes() -> list[str]:
    """Modules that the scenes simulated so far have imported, in the order of their import."""
    packages = tuple({".".join(reference.split(".")[:2]) + "." for reference in SCENES.values()})
    return [name for name in sys.modules if name.startswith(packages)]


def _import_function(reference: str) -> tuple[Callable[..., Any], dict[str, bytes]]:
    """A function, and the files of its code; imported again if this process has imported others by their names."""
    module = reference.partition(":")[0]
    called = _import_object(reference)
    sources = sources_of(module)
    before = _sources.setdefault(sys.modules[module], sources)
    root = import_root(module, sys.modules[module].__file__ or "") if sources else Path()
    files = {module_name(path): (str(root / path), text) for path, text in sources.items()}
    paths = {**before, **sources}
    changed = [path for path in paths if before.get(path) != sources.get(path) or _is_another(module_name(path), files)]
    # a script keeps what it has imported
    if stay := [path for path in changed if module == "__main__" or stays_loaded(path)]:
        raise InputError(
            f"function = {reference!r}: {stay[0]} has changed since it was loaded here: start Python again"
        )
    if changed:
        _unload(module_name(path) for path in paths if not stays_loaded(path))
        called = _import_object(reference)
        _sources[sys.modules[module]] = sources
    if not callable(called):
        raise InputError(f"function = {reference!r}: this is not a function")
    _loaded.update({name: own for name, own in files.items() if name in sys.modules})
    return called, sources


def _is_another(name: str, files: Mapping[str, tuple[str, bytes]]) -> bool:
    """Whether a module that was loaded for a function has another file or text, as a helper in another folder has."""
    known = _loaded.get(name)
    return known not in (None, files.get(name)) and getattr(sys.modules.get(name), "__file__", None) == known[0]


def _import_object(reference: str) -> Any:
    module_name, separator, name = reference.partition(":")
    if not separator:
        raise InputError(f"function = {reference!r}: write it as package.module:function")
    try:
        module = importlib.import_module(module_name)
    except TripodDoeError:  # its message is for the user
        raise
    except Exception as error:  # a user's module may raise anything
        kind = "" if isinstance(error, ImportError) else f"{type(error).__name__}: "
        raise InputError(f"function = {reference!r}: cannot import {module_name}: {kind}{error}") from error
    if not hasattr(module, name):
        raise InputError(f"function = {reference!r}: no {name} in {module_name}{near_match(name, dir(module))}")
    return getattr(module, name)
