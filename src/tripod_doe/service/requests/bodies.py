"""Bodies of requests, parsed in a worker: JSON that fits its form, within the limits."""

import json
import re
from collections import Counter
from typing import Any, NoReturn, TypeVar

from pydantic import BaseModel, ValidationError

from tripod_doe.service.problems import Problem, RefusedError, form_problem

_ESCAPED = re.compile(rb"\\.", re.DOTALL)
_TEXTS = re.compile(rb'"[^"]*"?')  # an unclosed text runs to the end, so each byte is read once
_MOST_DIGITS = 100
_LONGEST = 100  # characters of a key in a message
_MOST_PROBLEMS = 20

Form = TypeVar("Form", bound=BaseModel)


def read_form(body: bytes, form: type[Form], nesting: int) -> Form:
    """Read a body that has a form.

    Raises:
        RefusedError: 413 if it is nested too deep, 422 if it is no JSON or does not fit the form.
    """
    try:
        return form.model_validate(read_json(body, nesting))
    except ValidationError as error:
        errors = error.errors(include_url=False)
        problems = [form_problem(item) for item in errors[:_MOST_PROBLEMS]]
        if len(errors) > _MOST_PROBLEMS:
            problems.append(Problem(message=f"and {len(errors) - _MOST_PROBLEMS:,} more"))
        raise RefusedError(422, *problems) from error


def read_json(body: bytes, nesting: int) -> Any:
    """Read the JSON of a body; see `read_form`."""
    if _depth(body) > nesting:
        raise RefusedError(413, f"brackets are nested more than {nesting} deep, the limit here")
    try:
        text = body.decode()
        value = json.loads(text, object_pairs_hook=_object, parse_constant=_refuse_constant, parse_int=_whole)
        if "\\ud" in text.lower():
            json.dumps(value, ensure_ascii=False).encode()  # a single surrogate cannot be encoded
        return value
    except UnicodeError as error:
        raise RefusedError(422, "the body is not UTF-8 text") from error
    except json.JSONDecodeError as error:
        message = f"the body is not JSON: {error.msg[0].lower()}{error.msg[1:]}"
        raise RefusedError(422, Problem(message=message, line=error.lineno, column=error.colno)) from error


def _refuse_constant(text: str) -> NoReturn:
    raise RefusedError(422, f"the body is not JSON: it holds {text}, which is no number of JSON")


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    content = dict(pairs)
    if len(content) < len(pairs):
        counts = Counter(name for name, _ in pairs)
        twice = next(name for name, count in counts.items() if count > 1)[:_LONGEST]
        raise RefusedError(422, Problem(message=f"{twice}: the body has this key twice", key=twice))
    return content


def _whole(text: str) -> int:
    if len(text) > _MOST_DIGITS:
        raise RefusedError(422, f"the body holds a number of {len(text):,} digits; at most {_MOST_DIGITS} are read")
    return int(text)


def _depth(body: bytes) -> int:
    """Nesting depth of the brackets in a JSON text, without brackets in strings."""
    depth = deepest = 0
    for letter in re.findall(rb"[\[{\]}]", _TEXTS.sub(b"", _ESCAPED.sub(b"", body))):
        depth += 1 if letter in b"[{" else -1
        deepest = max(deepest, depth)
    return deepest
