"""Files that may be delivered: regular ones of this user, which no other user can change."""

import grp
import os
import pwd
import stat
from collections.abc import Iterator
from functools import cache
from pathlib import Path

from tripod_doe.service.problems import RefusedError


def check_delivered(directory: Path, found: bool) -> None:
    """Refuse a result directory from which a client could get what its owner keeps elsewhere, or keeps private.

    The server runs as one user and answers others who have the token. It delivers regular files that this user owns,
    from directories that no other user can change, so that a checked file is still the same when it is opened.
    Nothing is delivered through a symbolic link. Where a directory that the command line filled is open to other users
    of the machine, a file that is closed to them was closed on purpose.

    Args:
        found: Whether the command line filled it.

    Raises:
        RefusedError: 403 with the name of the file and what to do.
    """
    try:
        top = os.lstat(directory)
        for path, state in _entries(directory):
            if reason := _refusal(state, top, found):
                raise RefusedError(403, f"{path.relative_to(directory.parent)}: {reason}")
    except OSError:  # it is being deleted, or not yet there: what reads it says so
        return


def file_within(folder: Path, place: str) -> Path | None:
    """The file in a folder that an address names; None where there is none, as where no file can have such a name."""
    path = Path(os.path.normpath(folder / place))
    if not path.is_relative_to(folder) or any(part.startswith(".") for part in path.relative_to(folder).parts):
        return None  # hidden files are not checked, so none is delivered
    try:
        there = path.is_file()
    except OSError:  # a name that is too long
        return None
    return path if there else None


def _refusal(state: os.stat_result, top: os.stat_result, found: bool) -> str:
    """The reason for which an entry is not delivered; empty if it is."""
    if stat.S_ISLNK(state.st_mode):
        return "a symbolic link, and none is followed: put the file itself there"
    if not (stat.S_ISREG(state.st_mode) or stat.S_ISDIR(state.st_mode)):
        return "neither a file nor a directory"
    if state.st_uid != os.geteuid():
        return "another user owns it than runs this server"
    if is_open_to_change(state):
        return f"other users can change it (mode {stat.S_IMODE(state.st_mode):04o}); run: chmod go-w"
    if found and _is_private(state) and not _is_private(top):
        mode = f"{stat.S_IMODE(state.st_mode):04o}"
        return f"private (mode {mode}) in a directory that is not: make both so, or neither"
    return ""


def is_open_to_change(state: os.stat_result) -> bool:
    """Whether other users can write to a file or add to a directory; the group of one user is no other user."""
    if state.st_mode & stat.S_IWOTH:
        return True
    return bool(state.st_mode & stat.S_IWGRP) and not _is_own_group(state.st_gid)


@cache
def _is_own_group(group: int) -> bool:
    """Whether a group has this user as its only member, as many systems make one for each user."""
    try:
        entry, own = grp.getgrgid(group), pwd.getpwuid(os.geteuid())
    except KeyError:
        return False
    return group == own.pw_gid and entry.gr_name == own.pw_name and not set(entry.gr_mem) - {own.pw_name}


def _is_private(state: os.stat_result) -> bool:
    """Whether other users can neither read a file nor look into a directory."""
    return not state.st_mode & (stat.S_IRGRP | stat.S_IROTH)


def _entries(directory: Path) -> Iterator[tuple[Path, os.stat_result]]:
    """The directory and all in it that is not hidden, links not followed."""
    waiting = [directory]
    while waiting:
        path = waiting.pop()
        state = os.lstat(path)
        yield path, state
        if stat.S_ISDIR(state.st_mode):
            waiting += [path / name for name in sorted(os.listdir(path), reverse=True) if not name.startswith(".")]
