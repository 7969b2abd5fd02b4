"""The folder of a study or workflow file, where its files and functions are looked up.

The user's own file may name any file and any function. A file from a stranger, such as an upload to the service, may
name files inside its folder, and no function, so that nothing of it is imported. In a result directory, copies of the
tables of its study stand for those that are not there.
"""

from __future__ import annotations

import hashlib
from dataclasses import KW_ONLY, dataclass, replace
from pathlib import Path
from typing import Self

from tripod_doe.errors import ForbiddenError, TooLargeError
from tripod_doe.model_interface import Simulator

_SHOWN = 100  # characters of a name in a message
_LISTED = 50  # files of a folder that a message names


def table_copy(directory: Path, name: str) -> Path:
    """Where a result directory has its copy of a table that its study names."""
    digest = hashlib.blake2b(name.encode(errors="replace"), digest_size=8).hexdigest()
    return directory / "tables" / f"{digest}.csv"


@dataclass(frozen=True)
class StudyFolder:
    """Folder of the files and functions of a study or workflow, and which are allowed."""

    path: Path
    trusted: bool = True  # whether functions, and files outside of the folder, may be named
    most_points: int | None = None  # of a study, and values of a factor; None without a limit
    _: KW_ONLY
    has_results: bool = False  # whether the study ran: it is not refused for what it did not read

    @classmethod
    def of(cls, file: str | Path, untrusted: bool = False) -> Self:
        """The folder of a file; `untrusted` for one from a stranger."""
        return cls(Path(file).resolve().parent, not untrusted)

    def around(self, file: Path) -> StudyFolder:
        """The folder of a file in this folder, under the same rules."""
        return replace(self, path=file.resolve().parent)

    def file(self, name: str, key: str) -> Path:
        """The path of a file by its name, which is relative to this folder and is under a key.

        Raises:
            ForbiddenError: In a file from a stranger, for a name that leads out of the folder, or to nothing in it.
        """
        copy = table_copy(self.path, name)
        if copy.is_file() and not (self.path / name).exists():
            name = str(copy.relative_to(self.path))
        if self.trusted:
            return self.path / name
        try:
            path, folder = (self.path / name).resolve(), self.path.resolve()
            inside = bool(name) and not Path(name).is_absolute() and path.is_relative_to(folder)
            there = inside and path.is_file()
        except (OSError, ValueError, RuntimeError):  # a name that no file can have, or links in a circle
            inside = there = False
        if not inside:
            raise ForbiddenError(
                f"{key} = {name[:_SHOWN]!r}: a file from elsewhere: put it next to this one and give its plain name, "
                "without a folder"
            )
        if not there:
            known = sorted(other.name for other in folder.iterdir()) if folder.is_dir() else []
            listed = ", ".join(known[:_LISTED]) + (", ..." if len(known) > _LISTED else "")
            raise ForbiddenError(f"{key} = {name[:_SHOWN]!r}: not among the files here ({listed})")
        return path

    def check_file(self, name: str, key: str) -> None:
        """Refuse (ForbiddenError) the name of a file that would be refused when it is read."""
        self.file(name, key)

    def recorded_function(self, function: str) -> Simulator | None:
        """The stand-in for a function that must not be imported; None if it is imported, or refused."""
        return None

    def refuse_functions(self, function: str) -> None:
        """Refuse (ForbiddenError) a function that a file from a stranger names."""
        if not self.trusted:
            raise ForbiddenError(
                f"function = {function[:_SHOWN]!r}: functions are not allowed here: run such a study from the command "
                "line"
            )

    def refuse_many(self, count: int, what: str, remedy: str = "") -> None:
        """Refuse (TooLargeError) more points, or values of a factor, than are allowed here."""
        if self.most_points is not None and count > self.most_points:
            raise TooLargeError(f"{count:,} {what}; at most {self.most_points:,} points are allowed here{remedy}")
