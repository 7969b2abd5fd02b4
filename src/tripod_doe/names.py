"""Names from files and addresses: what may be one, and the one function that makes paths of them."""

from __future__ import annotations

import re
import unicodedata
from pathlib import Path

from tripod_doe.errors import InputError

_IDENTIFIER = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_-]*")
_LONGEST = 100  # characters of a name
_LONGEST_FILE = 250  # characters of the name of a file
_SHOWN = 60  # characters of a wrong name in a message
_DEVICES = re.compile(r"(?:con|prn|aux|nul|com[0-9]|lpt[0-9])(?:\..*)?", re.IGNORECASE)
_CUBE_NAME = re.compile(r"\w[^\x00-\x1f\x7f/\ud800-\udfff]*")  # as netCDF has it
_NO_FILE = re.compile(r"[\x00-\x1f\x7f/\\]")


def check_identifier(name: str, of: str) -> str:
    """A name that a file gives to an analysis, a step or the like, checked: files are called by it.

    Raises:
        InputError: If it holds anything but letters, digits, _ and -, begins with -, is too long, or names a device.
    """
    if not _IDENTIFIER.fullmatch(name) or len(name) > _LONGEST:
        raise InputError(
            f"{_shown(name)}: not a name for {of}: use letters a to z, digits, _ and -, at most {_LONGEST}, and no - "
            "in front"
        )
    if _DEVICES.fullmatch(name):
        raise InputError(f"{_shown(name)}: not a name for {of}: Windows reserves it for a device")
    return name


def path_within(folder: Path, *names: str) -> Path:
    """Make the path of a file below a folder from the names of its folders and of the file.

    Every path that is made of a name from a file or an address is made here.

    Raises:
        InputError: If a name is no file name: it is empty, holds separators or control characters, or begins with a
            dot.
    """
    for name in names:
        if not name or name.startswith(".") or len(name) > _LONGEST_FILE or _NO_FILE.search(name):
            raise InputError(f"{_shown(name)}: not a name of a file")
        if _DEVICES.fullmatch(name):
            raise InputError(f"{_shown(name)}: not a name of a file: Windows reserves it for a device")
    return folder.joinpath(*names)


def check_cube_name(name: str, of: str) -> str:
    """A name of a variable or dimension that a netCDF file can hold, checked before anything is computed for it.

    Raises:
        InputError: If it holds a slash or control character, does not begin with a letter, a digit or _, ends with a
            space, is too long, or is written in a form of Unicode that comes back as another.
    """
    if (
        not _CUBE_NAME.fullmatch(name)
        or name != name.rstrip()
        or len(name) > _LONGEST
        or unicodedata.normalize("NFC", name) != name
    ):
        raise InputError(
            f"{of} {_shown(name)}: a cube cannot hold this name: begin with a letter, a digit or _, and use no slash, "
            f"no control character, no space at the end, and at most {_LONGEST} characters"
        )
    return name


def _shown(name: str) -> str:
    return ascii(name if len(name) <= _SHOWN else f"{name[:_SHOWN]}...")
