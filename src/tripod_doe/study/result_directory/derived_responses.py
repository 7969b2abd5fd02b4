"""Responses that were added to results: read from a file, and put into the text of the stored study."""

from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

import tomlkit
from tomlkit.exceptions import TOMLKitError

from tripod_doe.errors import InputError, near_match
from tripod_doe.study.definition.study import Study
from tripod_doe.study.definition.study_file import parse_study
from tripod_doe.study.definition.toml_text import parse_toml, read_text
from tripod_doe.study.result_directory.stored_study import STORED, read_again, stored_text

DERIVED = "derived"
"""Note in the journal: responses that were added to the results, as JSON of their tables by name."""


def with_responses(directory: Path, file: Path | None, drop: Collection[str] = ()) -> tuple[Study, dict[str, Any]]:
    """Read the study of a result directory, with the responses of a file added to its own, or in place of them.

    Args:
        file: TOML file of responses; None where none is added.
        drop: Names of responses that are left out.

    Returns:
        The study, and the tables of the responses that were added.

    Raises:
        InputError: If the file holds anything else, or a response that the study cannot have, or one to drop is not
            there.
    """
    stored, origin = stored_text(directory), str(file or directory / STORED)
    added = {} if file is None else read_responses(file)
    text = text_with_responses(stored, added, drop)
    return read_again(directory, text, origin), added


def read_responses(file: Path) -> dict[str, Any]:
    """The tables of a file that holds responses alone."""
    added = parse_toml(read_text(file, "file of responses"), str(file))
    if wrong := [key for key in added if key != "responses"] or ([] if added.get("responses") else ["responses"]):
        reason = "is missing" if wrong == ["responses"] else "only [responses.NAME] is allowed here"
        raise InputError(f"{file}: [{wrong[0]}]: {reason}; to change anything else, run the study again")
    if not isinstance(added["responses"], dict):
        raise InputError(f"{file}: responses = {added['responses']!r}: expected tables, as [responses.NAME]")
    tables: dict[str, Any] = added["responses"]
    return tables


def text_with_responses(text: str, tables: Mapping[str, Any], drop: Collection[str] = ()) -> str:
    """The text of a study with responses added, or in place of those of the same names, and without those to drop."""
    document: Any = tomlkit.parse(text)
    there = {**document.get("responses", {}), **tables}
    if unknown := [name for name in drop if name not in there]:
        raise InputError(f"drop: {unknown[0]!r} is not a response here{near_match(unknown[0], there)}")
    try:
        document["responses"] = {name: table for name, table in there.items() if name not in drop}
        return tomlkit.dumps(document)
    except TOMLKitError as error:  # null in JSON
        raise InputError(f"responses: {error}: expected texts and numbers") from error


def with_derived(study: Study, tables: Mapping[str, Any]) -> Study:
    """A study with the responses that were added to its results, unless it has others of the same names."""
    kept = {name: table for name, table in tables.items() if name not in study.file.responses}
    if not kept:
        return study
    return parse_study(text_with_responses(study.text, kept), study.origin, study.folder)
