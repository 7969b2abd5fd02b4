"""What a client uploads: texts by plain names, checked before any of it is used."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from tripod_doe.service.limits import Limits
from tripod_doe.service.problems import ForbiddenError, TooLargeError
from tripod_doe.study.file import parse_toml

STUDY, WORKFLOW = "study.toml", "workflow.toml"
"""Names under which the submitted text itself is kept."""


def main_file(kind: str) -> str:
    """Name of the submitted text of a "study" or a "workflow"."""
    return WORKFLOW if kind == "workflow" else STUDY


_PLAIN = re.compile(r"[A-Za-z0-9_][A-Za-z0-9._-]{0,99}")
_SHOWN = 100  # characters of a name in a message


def upload_texts(body: Mapping[str, Any]) -> tuple[str, dict[str, str]]:
    """The main file of a request and all its texts by name: ``{"study": text, "files": {name: text}}`` or a workflow.

    Raises
    ------
    ForbiddenError
        If a file's name is not a plain one.
    """
    main = WORKFLOW if body.get("workflow") is not None else STUDY
    texts = {main: str(body["workflow" if main == WORKFLOW else "study"])}
    for name, text in (body.get("files") or {}).items():
        _check_plain(name, "files")
        if name == main:
            raise ForbiddenError(f"files: {name}: this is the name of the submitted file itself; choose another")
        texts[name] = text
    return main, texts


def write_upload(folder: Path, texts: Mapping[str, str]) -> None:
    """Write uploaded texts into a folder of their own."""
    folder.mkdir(parents=True)
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8", newline="")


def check_upload(texts: Mapping[str, str], limits: Limits) -> None:
    """Refuse functions of a user's own, files from elsewhere and too many values, from the parsed texts alone.

    Raises
    ------
    ForbiddenError
        For a function, or a file that is not an uploaded one by its plain name.
    TooLargeError
        For more values of one factor than a study may have points.
    InputError
        If a text is not TOML.
    """
    if len(texts) - 1 > limits.files:
        raise TooLargeError(f"files: {len(texts) - 1:,} files; at most {limits.files:,} are taken here")
    for origin, text in texts.items():
        if not _is_toml(origin):
            continue
        raw = parse_toml(text, origin)
        for path, value in _entries(raw):
            where = f"{origin}: [{'.'.join(path[:-1])}]: {path[-1]} = {str(value)[:_SHOWN]!r}"
            if path == ["study", "function"]:
                raise ForbiddenError(f"{where}: functions are not allowed here: run such a study from the command line")
            if path[-1] in _FILE_KEYS and isinstance(value, str) and not _names_a_step(path):
                _check_file(where, value, texts)
            if path[-1] == "count" and isinstance(value, int) and value > limits.points:
                raise TooLargeError(f"{where}: at most {limits.points:,} points are allowed here")


_FILE_KEYS = {"table", "study", "measurement"}
"""Keys that name a file, in whatever table they stand."""


def _names_a_step(path: list[str]) -> bool:
    """Whether ``table`` is that of a workflow's study step, which names another step."""
    return path[0] == "steps" and len(path) == 3 and path[-1] == "table"


def _check_file(where: str, name: str, texts: Mapping[str, str]) -> None:
    if not _PLAIN.fullmatch(name):
        raise ForbiddenError(f"{where}: upload the file and give its plain name, without a folder")
    if name not in texts:
        uploaded = ", ".join(texts)
        raise ForbiddenError(f"{where}: not among the uploaded files ({uploaded})")


def _check_plain(name: str, where: str) -> None:
    if not _PLAIN.fullmatch(name) or ".." in name:
        raise ForbiddenError(f"{where}: {name[:_SHOWN]!r}: a plain name is needed: letters, digits, dots, - and _")


def _is_toml(name: str) -> bool:
    return name.endswith(".toml")


def _entries(table: Mapping[str, Any], path: tuple[str, ...] = ()) -> Iterator[tuple[list[str], Any]]:
    """All keys of nested tables with their values."""
    for key, value in table.items():
        yield [*path, key], value
        if isinstance(value, Mapping):
            yield from _entries(value, (*path, key))
