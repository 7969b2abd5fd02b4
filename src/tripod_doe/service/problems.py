"""Complaints as objects: the sentences of the command line with key, value, near match, line and column apart."""

from __future__ import annotations

import ast
import re
from typing import Any

from pydantic import BaseModel, ConfigDict, Field

from tripod_doe.errors import InputError
from tripod_doe.service.toml_places import Place, place_of

_MESSAGE = re.compile(
    r"(?:\[(?P<table>[^\]\s]+)\]:? ?)?(?:(?P<key>[A-Za-z_][\w.-]*) ?= ?(?P<value>.+?): )?(?P<told>.*)", re.DOTALL
)
_NAMED = re.compile(r"unknown (?:key|parameter|output|name) '([^']+)'|^([\w.-]+) is (?:missing|both)|^([\w.-]+): ")
_STEP = re.compile(r"^\[steps\.[^\]]+\]: ")
_NEAR = re.compile(r"did you mean '([^']+)'")
_AT = re.compile(r"\(at line (\d+), column (\d+)\)")
_TABLES = {"designs": "design"}  # as the checked form calls them, and as a file writes them


class Problem(BaseModel):
    """One thing that is wrong with a request."""

    model_config = ConfigDict(frozen=True)

    message: str = Field(description="the whole sentence")
    key: str | None = Field(None, description="what it is about, as it was written")
    value: Any = Field(None, description="its value, as it was written")
    line: int | None = Field(None, description="where it stands in its file, counted from 1")
    column: int | None = Field(None, description="where it stands in its line, counted from 1")
    near: str | None = Field(None, description="the known name that was probably meant")
    file: str | None = Field(None, description="the uploaded file")
    table: str | None = Field(None, description="the table in that file")


class RefusedError(Exception):
    """A request that is answered by a status and a list of problems."""

    def __init__(self, status: int, *problems: Problem | str, headers: dict[str, str] | None = None) -> None:
        self.status = status
        self.problems = [Problem(message=problem) if isinstance(problem, str) else problem for problem in problems]
        self.headers = headers or {}
        super().__init__(f"{status}: {'; '.join(problem.message for problem in self.problems)}")

    def answer(self) -> dict[str, Any]:
        """The body of the answer."""
        return {"errors": [problem.model_dump() for problem in self.problems]}


def problems_of(error: InputError | str, texts: dict[str, str]) -> list[Problem]:
    """Take the sentences of an error apart.

    Parameters
    ----------
    error
        What was raised, or its text; one complaint a line.
    texts
        Uploaded files by name; a sentence about one starts with its name.
    """
    problems: list[Problem] = []
    for line in str(error).split("\n"):
        if line.strip():
            file = problems[-1].file if line.startswith("  ") and problems else None  # a list goes on
            problems.append(_problem(line.strip(), file, texts))
    return problems


def _problem(told: str, file: str | None, texts: dict[str, str]) -> Problem:
    while (name := next((name for name in texts if _STEP.sub("", told).startswith(f"{name}: ")), None)) is not None:
        file, told = name, _STEP.sub("", told).removeprefix(f"{name}: ")  # a workflow's goes on with its study's
    match = _MESSAGE.fullmatch(told)
    assert match is not None
    table, key, value, rest = match["table"], match["key"], match["value"], match["told"]
    if key is None and (named := _NAMED.search(rest)):
        key = next(name for name in named.groups() if name)
    path = [*(table.split(".") if table else []), *(key.split(".") if key else [])]
    if key and len(path) > 1:
        table, key = ".".join(path[:-1]), path[-1]
    elif table and not key:
        key = path[-1]
    path[:1] = [_TABLES.get(name, name) for name in path[:1]]
    line, column = _place(told, texts.get(file or ""), path)
    near = _NEAR.search(rest)
    return Problem(
        message=told,
        key=key,
        value=_value(value),
        line=line,
        column=column,
        near=near[1] if near else None,
        file=file,
        table=table,
    )


def _place(told: str, text: str | None, path: list[str]) -> tuple[int | None, int | None]:
    place: Place | None = None
    if at := _AT.search(told):
        place = Place(int(at[1]), int(at[2]))
    elif text is not None and told.endswith("(at end of document)"):
        lines = text.split("\n")
        place = Place(len(lines), len(lines[-1]) + 1)
    elif text is not None and path:
        place = place_of(text, path)
    return (place.line, place.column) if place else (None, None)


def _value(written: str | None) -> Any:
    """A value as a message repeats it, as a value again; what is no literal stays text."""
    if written is None:
        return None
    try:
        value = ast.literal_eval(written)
    except (ValueError, SyntaxError, MemoryError, RecursionError):
        return written
    return value if isinstance(value, str | int | float | bool) else written
