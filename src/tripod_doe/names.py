"""Names from files and addresses: what may be one, and the one function that makes paths of them."""

from __future__ import annotations

import re
from pathlib import Path

from tripod_doe.errors import InputError

_IDENTIFIER = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_-]*")
_LONGEST = 100  # characters of a name
_LONGEST_FILE = 250  # characters of the name of a file
_SHOWN = 60  # characters of a wrong name in a message
_DEVICES = re.compile(r"(?:con|prn|aux|nul|com[0-9]|lpt[0-9])(?:\..*)?", re.IGNORECASE)
_NO_FILE = re.compile(r"[\x00-\x1f\x7f/\\]")


def check_identifier(name: str, of: str) -> str:
    """A name that a file gives to an analysis, a step or the like, checked: files are called by it.

    Parameters
    ----------
    name
        The name.
    of
        What has it, for the message.

    Raises
    ------
    InputError
        If it holds anything but letters, digits, _ and -, begins with -, is too long, or names a device.
    """
    if not _IDENTIFIER.fullmatch(name) or len(name) > _LONGEST:
        raise InputError(
            f"{_shown(name)}: not a name for {of}: use letters a to z, digits, _ and -, at most {_LONGEST}, and no - "
            "in front"
        )
    if _DEVICES.fullmatch(name):
        raise InputError(f"{_shown(name)}: not a name for {of}: Windows keeps it for a device")
    return name


def path_within(folder: Path, *names: str) -> Path:
    """Make the path of a file below a folder from the names of its folders and of the file.

    Every path that is made of a name from a file or an address is made here.

    Raises
    ------
    InputError
        If a name is no file name: it is empty, holds separators or control characters, or begins with a dot.
    """
    for name in names:
        if not name or name.startswith(".") or len(name) > _LONGEST_FILE or _NO_FILE.search(name):
            raise InputError(f"{_shown(name)}: not a name of a file")
        if _DEVICES.fullmatch(name):
            raise InputError(f"{_shown(name)}: not a name of a file: Windows keeps it for a device")
    return folder.joinpath(*names)


def _shown(name: str) -> str:
    return ascii(name if len(name) <= _SHOWN else f"{name[:_SHOWN]}...")
