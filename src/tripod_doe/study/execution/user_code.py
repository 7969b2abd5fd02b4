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

from tripod_doe.study.definition.function_sources import module_name, module_paths, sources_of

_OURS = "tripod_doe"


@dataclass(frozen=True)
class UserCode:
    """Sources of a function."""

    module: str  # where the function is imported from
    # sources of this module and of all others that it imports from the study's folder, by their paths below it
    files: Mapping[str, bytes]

    @property
    def digest(self) -> str:
        """A digest of these files."""
        parts = (part for path in sorted(self.files) for part in (path.encode(), self.files[path]))
        return hashlib.blake2b(b"\0".join(parts), digest_size=16).hexdigest()


def read_user_code(function: str, folder: Path) -> UserCode:
    """The code of a function that this process has imported, with modules that it has imported by other ways.

    Args:
        function: ``package.module:function``.
    """
    module = function.partition(":")[0]
    loaded = {
        path: (folder / path).read_bytes()
        for name, loaded in sorted(sys.modules.items())
        if (path := _path_below(folder, name, getattr(loaded, "__file__", None)))
    }
    here = {path: text for path, text in sources_of(module).items() if (folder / path).is_file()}
    return UserCode(module, here | loaded)


def _path_below(folder: Path, name: str, file: str | None) -> str:
    """The path of a module relative to its import folder; empty for a module from elsewhere."""
    if not file or name.partition(".")[0] == _OURS:
        return ""
    return next((path for path in module_paths(name) if Path(file).absolute() == (folder / path).absolute()), "")


_placed: dict[str, str] = {}
"""On a worker: digest and folder of the latest import, by module."""
_copies: dict[str, tempfile.TemporaryDirectory[str]] = {}
"""On a worker: copies of code by its digest; they go with the process."""


def placed(code: UserCode, folder: str) -> str:
    """On a worker: the folder to import a function from; earlier versions of its modules are unloaded."""
    place = folder if _sees(code, folder) else _copy(code)
    here = f"{code.digest} {place}"
    if _placed.get(code.module, here) != here:
        for name in {*map(module_name, code.files)} & sys.modules.keys():
            del sys.modules[name]
        importlib.invalidate_caches()
    _placed[code.module] = here
    return place


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
