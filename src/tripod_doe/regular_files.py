"""Refuse pipes and devices: opening a pipe waits for a writer, and a device may never end."""

from __future__ import annotations

import stat
from collections.abc import Callable
from pathlib import Path

from tripod_doe.errors import InputError

_KINDS: dict[str, Callable[[int], bool]] = {
    "a folder": stat.S_ISDIR,
    "a pipe": stat.S_ISFIFO,
    "a device": lambda mode: stat.S_ISCHR(mode) or stat.S_ISBLK(mode),
    "a socket": stat.S_ISSOCK,
}


def refuse_irregular(path: Path, error: type[InputError] = InputError) -> None:
    """Refuse a pipe, a device, a socket or a folder where a file is expected, also behind a link; nothing is opened.

    Args:
        path: Where a file is expected; nothing is refused where nothing is.
        error: What is raised.

    Raises:
        InputError: With its kind.
    """
    try:
        mode = path.stat().st_mode
    except (OSError, ValueError):  # opening it states the reason
        return
    if not stat.S_ISREG(mode):
        kind = next((kind for kind, is_kind in _KINDS.items() if is_kind(mode)), "something else")
        raise error(f"{path}: {kind} is in the place of this file, and is not read; delete it")
