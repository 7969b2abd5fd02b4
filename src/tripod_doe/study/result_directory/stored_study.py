"""The study stored in a result directory, read without running code or following a path.

A directory may come from a stranger. To show its points, its study is read again: its function is never imported, its
arguments are recorded in the journal, and its tables are copies in the directory.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import tomlkit

from tripod_doe.errors import CubeError, InputError, option
from tripod_doe.files.checksum_list import refuse_other_results, write_listed
from tripod_doe.files.regular_files import STUDY_BYTES, TEXT_BYTES, read_regular, refuse_irregular
from tripod_doe.study.definition.function import FunctionSimulator, RecordedFunction
from tripod_doe.study.definition.study import Study
from tripod_doe.study.definition.study_file import parse_study
from tripod_doe.study.definition.study_file_schema import StudyFile, parse_file
from tripod_doe.study.definition.study_folder import StudyFolder, table_copy
from tripod_doe.study.definition.toml_text import read_text
from tripod_doe.study.journal import STUDY, Journal, journal_path, text_digest

STORED = "study.toml"
"""File of a result directory with the study whose results are there."""

FUNCTION = "function"
"""Note in the journal: arguments and candidates of the study's function."""


_TABLE_BYTES = 100_000_000  # of a table that is sent to a client


@dataclass(frozen=True)
class ResultFolder(StudyFolder):
    """Folder of tables and the function of a stored study: the directory itself."""

    record: Mapping[str, Any] = field(default_factory=dict)  # of the function, as `RecordedFunction` takes it
    has_results: bool = field(default=True, kw_only=True)

    def file(self, name: str, key: str) -> Path:
        """The copy of a table; InputError if there is none."""
        try:
            copy = table_copy(self.path, name)
            return StudyFolder(copy.parent, trusted=False).file(copy.name, key)
        except InputError as error:
            raise InputError(
                f"{key} = {name!r}: no copy of it in {self.path}: run the study again with the same {option('out')}"
            ) from error

    def check_file(self, name: str, key: str) -> None:
        """Do nothing: a table that no design reads has no copy."""

    def recorded_function(self, function: str) -> RecordedFunction:
        """The function of the study, which is not imported."""
        return RecordedFunction(function, self.record)


def stored_study(directory: Path, most_points: int | None = None) -> Study:
    """Read the study of a result directory.

    Args:
        most_points: Of the study; None without a limit.

    Raises:
        InputError: If it can no longer be read, or is damaged.
    """
    path, text = directory / STORED, stored_text(directory)
    try:
        return read_again(directory, text, str(path), most_points)
    except InputError as error:
        raise type(error)(
            f"{error}\n  this is the study whose results are in {directory}: put the file that was run in its place"
        ) from error


def read_again(directory: Path, text: str, origin: str, most_points: int | None = None) -> Study:
    """Read a text as the study of a result directory; see `stored_study`."""
    record = _record(directory, parse_file(text, origin))
    return parse_study(text, origin, ResultFolder(directory, False, most_points, record))


def texts_of_study(directory: Path) -> tuple[str, dict[str, str]]:
    """The study of a result directory as texts that need no other folder, as they are uploaded.

    Returns:
        Its text, which names its tables without folders; and its tables by these names.
    """
    path, tables = directory / STORED, {}
    text = stored_text(directory)
    file, document = parse_file(text, str(path)), tomlkit.parse(text)
    folder, table_of = ResultFolder(directory, trusted=False), document.get("design", {})
    for part, design in ((table_of, file.design), *((table_of[name], file.designs[name]) for name in file.designs)):
        name = design.table
        if design.kind != "table" or name is None or not table_copy(directory, name).is_file():
            continue
        copy = folder.file(name, "table")
        plain = f"table_{copy.name}" if "/" in name or "\\" in name else name
        if plain != name:
            part["table"] = plain
        tables[plain] = read_text(copy, "table", _TABLE_BYTES)
    return tomlkit.dumps(document), tables


def known_texts(journal: Journal) -> list[str]:
    """Digests of the texts that the study file may have: two after a kill that hit its replacement; none if unknown."""
    return (journal.recall(STUDY) or "").split()


def refuse_changed_study(directory: Path, journal: Journal) -> None:
    """Refuse the study file of a result directory if it is not the stored one.

    Raises:
        CubeError: If it was damaged or edited, or the directory holds files of another one.
    """
    refuse_other_results(directory)
    path = directory / STORED
    if not path.exists():
        return
    digest = text_digest(read_regular(path, STUDY_BYTES, CubeError, links=True))
    if (known := known_texts(journal)) and digest not in known:
        raise CubeError(
            f"{path}: damaged or edited: it is not the study of these results; run the study again with the same "
            f"{option('out')}, which stores it there"
        )


def stored_text(directory: Path) -> str:
    """The text of the study of a directory; CubeError if it is damaged: numbers must not be made of it."""
    path = directory / STORED
    if not path.exists():
        of_steps = "".join(f", as {path.parent}" for path in sorted(directory.glob(f"steps/*/{STORED}"))[:1])
        raise InputError(f"{directory}: no {STORED} here; name the result directory of a study{of_steps}")
    refuse_irregular(path)
    if journal_path(directory).is_file():
        with Journal(directory, read_only=True) as journal:
            refuse_changed_study(directory, journal)
    return read_text(path, "study")


def _record(directory: Path, file: StudyFile) -> dict[str, Any]:
    """The record of the study's function; the names in the study if the journal has lost it."""
    if file.study.function is None:
        return {}
    if journal_path(directory).is_file():
        with Journal(directory, read_only=True) as journal:
            if (note := journal.recall(FUNCTION)) is not None:
                return _recorded(note, directory)
    return {"arguments": dict.fromkeys([*file.base, *file.factors])}


def _recorded(note: str, directory: Path) -> dict[str, Any]:
    try:
        record: dict[str, Any] = json.loads(note)
        RecordedFunction("", record)
    except (ValueError, TypeError, AttributeError, RecursionError) as error:
        raise CubeError(
            f"{journal_path(directory)}: its note {FUNCTION!r} is no record of a function; run the study again with "
            f"the same {option('out')}"
        ) from error
    return record


def is_stored(directory: Path, file: Path) -> bool:
    """Whether a file is the study whose results are in a directory."""
    try:
        return (directory / STORED).is_file() and read_text(directory / STORED, "study") == read_text(file, "study")
    except InputError:
        return False


def keep_sources(study: Study, directory: Path) -> dict[str, str]:
    """Copy the tables of a study into its result directory.

    Returns:
        Notes for the journal on its function.

    Raises:
        StorageError: If a copy cannot be written.
    """
    for design in (study.file.design, *study.file.designs.values()):
        if design.kind == "table" and design.table is not None:
            text = read_text(study.folder.file(design.table, "table"), "table", TEXT_BYTES)
            copy = table_copy(directory, design.table)
            write_listed(copy, text)
    if isinstance(study.simulator, FunctionSimulator):
        return {FUNCTION: json.dumps(study.simulator.record, default=str)}
    return {}
