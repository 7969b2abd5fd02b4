"""The code of a user's function, sent to cluster workers with its blocks, so that all workers run the same code.

A worker with access to the study's folder imports from it, so that a function finds its data files. Other workers get a
copy of the modules that the function imports from that folder.

Why not `UploadDirectory`: it sends the whole folder, results included, needs nannies, and puts its copy before the
folder that a worker sees. `Client.upload_file` sends single modules, the same for all studies of a cluster.
"""

import hashlib
import importlib
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from tripod_doe.errors import InputError

_OURS = "tripod_doe"


@dataclass(frozen=True)
class UserCode:
    """Sources of a function."""

    module: str  # where the function is imported from
    # sources of this module and of all others that it imports from the study's folder, by their paths below it
    files: Mapping[str, bytes]
    digest: str  # of the module and these files


def read_user_code(function: str, folder: Path) -> UserCode:
    """The code of a function that this process has imported.

    Args:
        function: ``package.module:function``.
    """
    module = function.partition(":")[0]
    files = {
        path: (folder / path).read_bytes()
        for name, loaded in sorted(sys.modules.items())
        if (path := _path_below(folder, name, getattr(loaded, "__file__", None)))
    }
    return UserCode(module, files, _digest(module, files))


def _path_below(folder: Path, name: str, file: str | None) -> str:
    """The path of a module relative to its import folder; empty for a module from elsewhere."""
    if not file or name.partition(".")[0] == _OURS:
        return ""
    stem = name.replace(".", "/")
    paths = (f"{stem}.py", f"{stem}/__init__.py")
    return next((path for path in paths if Path(file).absolute() == (folder / path).absolute()), "")


def _digest(module: str, files: Mapping[str, bytes]) -> str:
    file = getattr(sys.modules[module], "__file__", None)
    own = Path(file).read_bytes() if file else b""  # a module without a file is part of Python
    parts = [own, *(part for path in sorted(files) for part in (path.encode(), files[path]))]
    return hashlib.blake2b(b"\0".join(parts), digest_size=16).hexdigest()


_placed: dict[str, str] = {}
"""On a worker: digest and folder of the latest import, by module."""
_copies: dict[str, tempfile.TemporaryDirectory[str]] = {}
"""On a worker: copies of code by its digest; they go with the process."""


def placed(code: UserCode, folder: str) -> str:
    """On a worker: the folder to import a function from; earlier versions of its modules are unloaded."""
    place = folder if _sees(code, folder) else _copy(code)
    here = f"{code.digest} {place}"
    if _placed.get(code.module, here) != here:
        names = {path.removesuffix(".py").removesuffix("/__init__").replace("/", ".") for path in code.files}
        for name in names & sys.modules.keys():
            del sys.modules[name]
        importlib.invalidate_caches()
    _placed[code.module] = here
    return place


def check_imported(code: UserCode) -> None:
    """On a worker: refuse (InputError) another version of a module that is installed there."""
    if _digest(code.module, code.files) != code.digest:
        raise InputError(f"it has another version of {code.module}; install the same on all machines")


def _sees(code: UserCode, folder: str) -> bool:
    try:
        return all((Path(folder) / path).read_bytes() == text for path, text in code.files.items())
    except OSError:
        return False


def _copy(code: UserCode) -> str:
    if code.digest not in _copies:
        _copies[code.digest] = tempfile.TemporaryDirectory(prefix="tripod-doe-")
        for path, text in code.files.items():
            target = Path(_copies[code.digest].name) / path
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_bytes(text)
    return _copies[code.digest].name
