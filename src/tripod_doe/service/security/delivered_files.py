"""Files that may be delivered: regular ones of this user, which no other user can change."""

import grp
import os
import pwd
import stat
from collections.abc import Iterator
from functools import cache
from itertools import islice
from pathlib import Path

from tripod_doe.service.problems import RefusedError

_MOST_FILES = 5_000  # of a part: a study or a step has some thirty
_STEPS = "steps"
_LONGEST_SHOWN = 200  # characters of a path


def check_delivered(directory: Path, found: bool, part: str = "") -> None:
    """Refuse a part of a result directory that could give a client the owner's files from elsewhere, or private files.

    The server runs as one user and answers everyone who has the token. It delivers regular files that this user owns,
    from directories that no other user can change, so that a checked file is the same when it is opened. It follows no
    symbolic link. If a directory that the command line filled is readable for other users of the machine, a file that
    they cannot read is private on purpose.

    Args:
        found: Whether the command line alone filled it: what this service writes is private anywhere.
        part: The file or folder that an answer reads; empty for all but the steps, each of which is a part of its own.

    Raises:
        RefusedError: 403 with the name of the file and what to do.
    """
    try:
        top = os.lstat(directory)
    except FileNotFoundError:  # being deleted, or not there yet: its reader reports that
        return
    for count, (path, state) in enumerate(_entries(directory, part)):
        if reason := _refusal(state, top, found):
            raise RefusedError(403, f"{_shown(path, directory)}: {reason}")
        if count > _MOST_FILES:
            place = _shown(str(directory / part), directory)
            raise RefusedError(403, f"{place}: more than {_MOST_FILES:,} files, the limit here")


def file_within(folder: Path, place: str) -> Path | None:
    """The file in a folder that an address names; None if there is none, or the name is impossible."""
    path = Path(os.path.normpath(folder / place))
    if not path.is_relative_to(folder) or any(part.startswith(".") for part in path.relative_to(folder).parts):
        return None  # hidden files are not checked, so they are not delivered
    try:
        there = path.is_file()
    except OSError:  # a name that is too long
        return None
    return path if there else None


def _refusal(state: os.stat_result, top: os.stat_result, found: bool) -> str:
    """The reason why an entry is not delivered; empty if it is delivered."""
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
    """Whether other users can write to a file or add to a directory; a group with this user alone does not count."""
    if state.st_mode & stat.S_IWOTH:
        return True
    return bool(state.st_mode & stat.S_IWGRP) and not _is_own_group(state.st_gid)


@cache
def _is_own_group(group: int) -> bool:
    """Whether this user is the group's only member; many systems make such a group for each user."""
    try:
        entry, own = grp.getgrgid(group), pwd.getpwuid(os.geteuid())
    except KeyError:
        return False
    return group == own.pw_gid and entry.gr_name == own.pw_name and not set(entry.gr_mem) - {own.pw_name}


def _is_private(state: os.stat_result) -> bool:
    """Whether other users can neither read a file nor look into a directory."""
    return not state.st_mode & (stat.S_IRGRP | stat.S_IROTH)


def _entries(directory: Path, part: str) -> Iterator[tuple[str, os.stat_result]]:
    """The folders above a part, and all entries in the part that are not hidden, without following links."""
    above = [str(directory / folder) for folder in Path(part).parents]
    apart, waiting = str(directory / _STEPS), [str(directory / part), *above]
    while waiting:
        path = waiting.pop()
        try:
            state = os.lstat(path)
            names = _names_in(path) if stat.S_ISDIR(state.st_mode) and path not in above else []
        except FileNotFoundError:  # a temporary file that is gone
            continue
        except OSError as error:  # what cannot be checked may hold anything
            raise RefusedError(403, f"{_shown(path, directory)}: cannot be checked ({error.strerror})") from error
        yield path, state
        waiting += [inner for name in names if (inner := f"{path}/{name}") != apart]


def _names_in(folder: str) -> list[str]:
    """Names in a folder that are not hidden, up to one more than the limit."""
    with os.scandir(folder) as entries:
        return list(islice((each.name for each in entries if not each.name.startswith(".")), _MOST_FILES + 1))


def _shown(path: str, directory: Path) -> str:
    return os.path.relpath(path, directory.parent)[:_LONGEST_SHOWN]
