"""Complaints as objects: sentences of the command line, split into key, value, near match, line and column."""

from __future__ import annotations

import ast
import math
import os
import re
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, Field

from tripod_doe.errors import ForbiddenError, InputError, TooLargeError

SERVER_ENDS = "the server is stopping: try again when it is back"
"""Message for requests that the end of the server interrupts."""

_MESSAGE = re.compile(
    r"(?:\[(?P<table>[^\]\s]+)\]:? ?)?(?:(?P<key>[A-Za-z_][\w.-]*) ?= ?(?P<value>.+?): )?(?P<message>.*)", re.DOTALL
)
_NAMED = re.compile(r"unknown (?:key|parameter|output|name) '([^']+)'|^([\w.-]+) is (?:missing|both)|^([\w.-]+): ")
_STEP = re.compile(r"^\[steps\.[^\]]+\]: ")
_NEAR = re.compile(r"did you mean '([^']+)'")
_AT = re.compile(r"\(at line (\d+), column (\d+)\)")
_MAKE_AGAIN = re.compile(
    r"(run the study again|make it again by the same command) with the same (--)?out\b"
    r"|make it again(: tripod-doe report ('[^']*'|[^\s;]+)|, or copy it again from where it was made)"
)
_RESUME = "resume this run (if the command line filled its directory, run the same command again)"
_MOST = 50  # problems that one answer lists
_LONGEST, _LONGEST_LINE = 1_000, 10_000  # characters of a value and of a message
_LARGEST = 10**30  # no key needs larger whole numbers
_TABLES = {"designs": "design"}  # name in the model, name in a file


class Problem(BaseModel):
    """One thing that is wrong with a request."""

    model_config = ConfigDict(frozen=True)

    message: str = Field(description="the whole sentence")
    key: str | None = Field(None, description="what it is about, as it was written")
    value: Any = Field(None, description="its value, as it was written")
    line: int | None = Field(None, description="where it is in its file, counted from 1")
    column: int | None = Field(None, description="where it is in its line, counted from 1")
    near: str | None = Field(None, description="the known name that was probably meant")
    file: str | None = Field(None, description="the uploaded file")
    table: str | None = Field(None, description="the table in that file")


class RefusedError(Exception):
    """A request that is refused with a status and a list of problems."""

    def __init__(self, status: int, *problems: Problem | str, headers: dict[str, str] | None = None) -> None:
        self.status = status
        self.problems = [Problem(message=problem) if isinstance(problem, str) else problem for problem in problems]
        self.headers = headers or {}
        super().__init__(f"{status}: {'; '.join(problem.message for problem in self.problems)}")

    def among_runs(self, folder: Path) -> RefusedError:
        """The same with the paths of `among_runs` in all its texts."""
        texts = [
            {name: among_runs(text, folder) for name, text in problem if isinstance(text, str)}
            for problem in self.problems
        ]
        problems = [problem.model_copy(update=own) for problem, own in zip(self.problems, texts, strict=True)]
        return RefusedError(self.status, *problems, headers=self.headers)

    def answer(self) -> dict[str, Any]:
        """The body of the answer."""
        return {"errors": [problem.model_dump() for problem in self.problems]}


def among_runs(text: str, folder: Path) -> str:
    """A text with paths that begin in the folder of runs: its clients need not know where that is on the server.

    Names of the service's temporary folders are left out, too, and commands that make a damaged file again.
    """
    text = _MAKE_AGAIN.sub(_RESUME, text.replace(f"{folder.absolute()}{os.sep}", ""))
    return re.sub(rf"{re.escape(tempfile.gettempdir())}{os.sep}tripod-doe-[^{os.sep}\s]*{os.sep}", "", text)


def refusal_of(error: InputError, texts: Mapping[str, str]) -> RefusedError:
    """Turn an error in a study file or a question into the refusal of its request."""
    status = 403 if isinstance(error, ForbiddenError) else 413 if isinstance(error, TooLargeError) else 422
    return RefusedError(status, *problems_of(error, texts))


def form_problem(item: Mapping[str, Any]) -> Problem:
    """A complaint of pydantic about a request's form."""
    place = [str(part) for part in item["loc"] if part not in ("body", "query", "path", "header")]
    key = ".".join(place)[:_LONGEST] or None
    value = item.get("input")
    message = item["msg"].removeprefix("Value error, ")
    message = message[0].lower() + message[1:]
    return Problem(message=f"{key}: {message}" if key else message, key=key, value=_plain(value))


def _plain(value: Any) -> Any:
    """The value if JSON can hold it, else None."""
    if isinstance(value, float):
        return value if math.isfinite(value) else str(value)
    if isinstance(value, str):
        return value[:_LONGEST]
    return value if isinstance(value, bool) or (isinstance(value, int) and abs(value) < _LARGEST) else None


def problems_of(error: InputError | str, texts: Mapping[str, str]) -> list[Problem]:
    """Split the sentences of an error into problems.

    Args:
        error: The exception, or its text; one complaint per line.
        texts: Uploaded files by name; a sentence about a file starts with its name.
    """
    problems: list[Problem] = []
    lines = str(error).split("\n")
    for line in lines[:_MOST]:
        if line.strip():
            file = problems[-1].file if line.startswith("  ") and problems else None  # continues a list
            problems.append(_problem(line.strip()[:_LONGEST_LINE], file, texts))
    if len(lines) > _MOST:
        problems.append(Problem(message=f"and {len(lines) - _MOST:,} more"))
    return problems


def _problem(message: str, file: str | None, texts: Mapping[str, str]) -> Problem:
    while (name := next((name for name in texts if _STEP.sub("", message).startswith(f"{name}: ")), None)) is not None:
        file, message = name, _STEP.sub("", message).removeprefix(f"{name}: ")  # after the workflow, the study
    match = _MESSAGE.fullmatch(message)
    assert match is not None
    table, key, value, rest = match["table"], match["key"], match["value"], match["message"]
    if key is None and (named := _NAMED.search(rest)):
        key = next(name for name in named.groups() if name)
    path = [*(table.split(".") if table else []), *(key.split(".") if key else [])]
    if key and len(path) > 1:
        table, key = ".".join(path[:-1]), path[-1]
    elif table and not key:
        key = path[-1]
    path[:1] = [_TABLES.get(name, name) for name in path[:1]]
    line, column = _place(message, texts.get(file or ""), path)
    near = _NEAR.search(rest)
    return Problem(
        message=message,
        key=key,
        value=_value(value),
        line=line,
        column=column,
        near=near[1] if near else None,
        file=file,
        table=table,
    )


def _place(message: str, text: str | None, path: list[str]) -> tuple[int | None, int | None]:
    place: Place | None = None
    if at := _AT.search(message):
        place = Place(int(at[1]), int(at[2]))
    elif text is not None and message.endswith("(at end of document)"):
        lines = text.split("\n")
        place = Place(len(lines), len(lines[-1]) + 1)
    elif text is not None and path:
        place = place_of(text, path)
    return (place.line, place.column) if place else (None, None)


def _value(written: str | None) -> Any:
    """Parse a value that a message repeats; text that is no literal stays text."""
    if written is None:
        return None
    try:
        value = ast.literal_eval(written)
    except (ValueError, SyntaxError, MemoryError, RecursionError):
        return written
    return _plain(value) if isinstance(value, str | int | float | bool) else written


_PART = r"""(?:[\w-]+|"[^"\n]*"|'[^'\n]*')"""
_NAME = rf"{_PART}(?:[ \t]*\.[ \t]*{_PART})*"
_HEADER = re.compile(rf"^[ \t]*\[\[?[ \t]*({_NAME})[ \t]*\]")
_KEY = re.compile(rf"^[ \t]*({_NAME})[ \t]*=")
_PARTS = re.compile(_PART)
_LONG_STRINGS = ('"""', "'''")


@dataclass(frozen=True)
class Place:
    """A place in a text."""

    # line, column: counted from 1
    line: int
    column: int


def place_of(text: str, path: list[str]) -> Place | None:
    """Find a key, or the innermost table around it that the text contains.

    Args:
        text: The TOML text; it need not be valid.
        path: Names of the tables and of the key, from the outside in.

    Returns:
        None if the text contains none of them.
    """
    best: tuple[int, Place] | None = None
    for written, place, line in _written(text):
        depth = len(written)
        if written != path[:depth] or (best and best[0] >= len(path)):
            continue
        column = _inside(line, path[depth:])
        if column is not None:
            return Place(place.line, column)
        if best is None or depth > best[0]:
            best = depth, place
    return best[1] if best else None


@lru_cache(maxsize=4)  # one error may have many complaints about the same text
def _written(text: str) -> list[tuple[list[str], Place, str]]:
    return list(_places(text))


def _places(text: str) -> Iterator[tuple[list[str], Place, str]]:
    """Headers and keys at the start of lines, with their full paths; skips the text of multi-line strings."""
    table: list[str] = []
    closing = ""
    for number, line in enumerate(text.split("\n"), start=1):
        if closing:
            closing = "" if closing in line else closing
            continue
        if header := _HEADER.match(line):
            table = _names(header[1])
            yield table, Place(number, header.start(1) + 1), ""
        elif key := _KEY.match(line):
            yield table + _names(key[1]), Place(number, key.start(1) + 1), line
        closing = next((quotes for quotes in _LONG_STRINGS if line.count(quotes) == 1), "")


def _names(written: str) -> list[str]:
    return [part.strip("\"'") for part in _PARTS.findall(written)]


def _inside(line: str, rest: list[str]) -> int | None:
    """Column of a key in the inline table on a line; None if there is no such key, or `rest` is empty."""
    if not rest or "{" not in line:
        return None
    match = re.search(rf"""[{{,][ \t]*["']?({re.escape(rest[-1])})["']?[ \t]*=""", line)
    return match.start(1) + 1 if match else None
