"""Imported first by each process that is a program of ours: libraries take settings from the owner's folders alone.

numba, matplotlib and netCDF also read files of the current folder, which may be a stranger's, or /tmp: a setting of
numba overwrites any file, and a pipe in the place of such a file is waited for without end. Python code of a user who
imports this package keeps its settings.
"""

import os
import sys
import threading
from importlib.machinery import ModuleSpec, PathFinder, SourceFileLoader
from types import ModuleType
from typing import Any

_FILES = {"numba.core.config": ".numba_config.yaml", "matplotlib": "matplotlibrc"}
_LOCK = threading.RLock()

# Before numpy is loaded: our problems of linear algebra are small, and the threads of a second core would only wait for
# it, next to workers at full load. Workers have one thread too, so a point gives the same anywhere.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("NCRCENV_IGNORE", "1")  # netCDF then reads no .ncrc, .daprc and .dodsrc


class _Loader(SourceFileLoader):
    """Loads a library that does not see its file of settings in the current folder."""

    def exec_module(self, module: ModuleType) -> None:
        """Run the code of the library, which asks whether the file exists."""
        hidden, exists = _FILES[module.__name__], os.path.exists
        with _LOCK:
            os.path.exists = lambda path: path != hidden and exists(path)
            try:
                super().exec_module(module)
            finally:
                os.path.exists = exists
        if "_config_fname" in vars(module):  # numba looks again before it compiles
            vars(module)["_config_fname"] = ""


class _Finder:
    """Finds these libraries."""

    @staticmethod
    def find_spec(name: str, path: Any = None, target: ModuleType | None = None) -> ModuleSpec | None:
        """The library with our loader; None for any other module."""
        spec = PathFinder.find_spec(name, path, target) if name in _FILES else None
        if spec is not None and spec.origin is not None:
            spec.loader = _Loader(name, spec.origin)
        return spec


sys.meta_path.insert(0, _Finder)
