"""Writes the pages of the reference that follow from the code.

python docs/reference/generate.py
"""

from __future__ import annotations

import inspect
import json
import re
import tempfile
import tomllib
from argparse import SUPPRESS, Action
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import tripod_doe as td
from tripod_doe.analyses.fit.fit_file import fit_schema
from tripod_doe.analyses.optimisation.optimisation_file import OptimisationFile
from tripod_doe.analyses.registry import ANALYSES
from tripod_doe.cli.main import COMMANDS, build_parser
from tripod_doe.cli.parser import Parser
from tripod_doe.service.app import create_app
from tripod_doe.service.settings import Settings
from tripod_doe.study.definition.simulators import SCENES, load_simulator
from tripod_doe.study.definition.study_file_schema import StudyFile
from tripod_doe.workflow.workflow_file import workflow_schema

_HERE = Path(__file__).parent
_NOTE = "Made from the code by `python docs/reference/generate.py`; do not edit.\n"
_EXITS = """\
Flags accept `-` and `_`. Answers go to standard output, progress and messages to standard error. Exit codes: 0 done;
1 internal error; 2 wrong call or input, nothing started; 3 done, but points or steps failed that were not expected;
130 interrupted.
"""


_HTTP = """\
`tripod-doe serve` answers under `/api/v1`, with the token as `Authorization: Bearer TOKEN`.
Bodies and answers are JSON unless a route names another form.
`/api/v1/openapi.json` is this page for programs. Limits and faults: [The service over HTTP](service.md).

The calls below begin with these lines; token and port are in the line that `tripod-doe serve` prints:

```sh
SERVER=http://127.0.0.1:8811/api/v1
TOKEN="Authorization: Bearer paste-the-token-here"
JSON="Content-Type: application/json"
RUN=6dd525f463c94dd8      # an id that POST /runs answered; OTHER is another one
```

A file goes into a body with `jq`: `jq -n --rawfile study my_joint.toml '{$study}' |` before a `curl` with `-d @-`.
In the answers shown, `"..."` stands for a long text or object, and a list shows its first entry.
"""
_EXAMPLES: dict[str, dict[str, Any]] = tomllib.loads((_HERE / "http_examples.toml").read_text(encoding="utf-8"))


def commands() -> str:
    """Every command with its arguments, as the command line reads them."""
    parts = ["# Commands\n", _NOTE, _EXITS]
    for name in COMMANDS:
        parser = build_parser([name])._subparsers._group_actions[0].choices[name]  # type: ignore[union-attr, index]
        rows = [(_call(action), (action.help or "") % vars(action) % {}) for action in _shown(parser)]
        parts.append(f"## {name}\n\n{_sentence(COMMANDS[name].help)}\n")
        if name == "simulate":
            parts.append(
                "Each parameter of the scene is a flag, too, as `--joint-angle-deg VALUE`: see"
                " [Parameters and outputs](parameters_and_outputs.md).\n"
            )
        parts.append(_table(("argument", "meaning"), rows))
    return "\n".join(parts)


def _shown(parser: Parser) -> Iterator[Action]:
    known = set(load_simulator("joint").parameters)
    for action in parser._actions:
        if action.dest not in known and action.dest != "help" and action.help != SUPPRESS:
            yield action


def _call(action: Action) -> str:
    value = action.metavar or (action.dest if not action.option_strings else action.dest.upper())
    if action.choices and not action.metavar:
        value = "|".join(map(str, action.choices))
    words = action.option_strings[-1:] + ([] if action.nargs == 0 else [str(value)])
    return f"`{' '.join(words)}`" + (" (required)" if action.option_strings and action.required else "")


def file_keys() -> str:
    """Every table and key of the files that people write."""
    parts = ["# Keys of files\n", _NOTE]
    optimisation = OptimisationFile.model_json_schema()
    for title, schema in (
        ("Study files", StudyFile.model_json_schema()),
        ("Workflow files", workflow_schema()),
        ("Fit files", fit_schema()),
        ("Optimisation files", optimisation),
    ):
        parts.append(f"## {title}\n")
        used = re.findall(r"\$defs/(\w+)", json.dumps(schema["properties"]))  # in the order of the file
        for name in dict.fromkeys([*used, *schema["$defs"]]):
            table = schema["$defs"][name]
            parts += [f"**{_cell(table['description'])}**\n", _keys(table)]
    parts.append(
        "## Settings of analyses\n\n`[analysis.NAME]` of a study file, or `[steps.NAME.settings]` of a workflow.\n"
    )
    for kind, row in ANALYSES.items():
        designs = ", ".join(f"`{name}`" for name in row.designs)
        where = f"Designs: {designs}." if designs else "In workflows only."
        parts += [f"### {kind}\n\n{_first_sentence(row.function)} {where}\n", _keys(row.settings.model_json_schema())]
    return "\n".join(parts)


def _keys(table: Mapping[str, Any]) -> str:
    rows = []
    for name, entry in table.get("properties", {}).items():
        default = "required" if name in table.get("required", ()) else _default(entry)
        words = [str(word) for word in _choices(entry)]
        text = _cell(entry.get("description", "")) + (f": {', '.join(f'`{word}`' for word in words)}" if words else "")
        rows.append((f"`{name}`", default, text))
    return _table(("key", "default", "meaning"), rows) if rows else ""


def _default(entry: Mapping[str, Any]) -> str:
    value = entry.get("default")
    return "" if value in (None, "", [], {}) else f"`{json.dumps(value)}`"


def _choices(entry: Mapping[str, Any]) -> list[Any]:
    found = list(entry.get("enum", ()))
    for part in (*entry.get("anyOf", ()), *filter(None, [entry.get("items")])):
        found += _choices(part)
    return found


def parameters_and_outputs() -> str:
    """Every parameter and output of every scene."""
    parts = ["# Parameters and outputs\n", _NOTE]
    parts.append(
        "Names are the same in study files, the command line, Python, cubes and tables.\n"
        "`tripod-doe schema study --brief` prints the same in the terminal.\n"
    )
    for scene in SCENES:
        simulator = load_simulator(scene)
        parts.append(f"## {scene}\n")
        groups: dict[str, list[tuple[str, ...]]] = {}
        for parameter in simulator.parameters.values():
            default = "" if parameter.default is None else f"{parameter.default}"
            row = (f"`{parameter.name}`", default, parameter.unit_text or "-", _cell(parameter.meaning))
            groups.setdefault(parameter.group, []).append((*row, _cell(parameter.range_text), _cell(parameter.source)))
        for group, rows in groups.items():
            parts += [
                f"### {scene}: {group}\n",
                _table(("parameter", "default", "unit", "meaning", "range", "source"), rows),
            ]
        outputs = [
            (
                f"`{output.name}`",
                output.unit_text or "-",
                _cell(output.meaning),
                ", ".join(f"`{name}`" for name in output.dims) or "-",
            )
            for output in simulator.outputs.values()
        ]
        parts += [f"### {scene}: outputs\n", _table(("output", "unit", "meaning", "dimensions"), outputs)]
    return "\n".join(parts)


def python() -> str:
    """Every public name of the package."""
    parts = [
        "# Names in Python\n",
        _NOTE,
        "[The package in Python](python.md) shows how they are used.\n",
        "```python\nimport tripod_doe as td\n```\n",
    ]
    for name in sorted(td.__all__, key=lambda name: (name[0].isupper(), name)):
        thing = getattr(td, name)
        parts.append(f"## {name}\n")
        if inspect.isfunction(thing):
            parts.append(f"```python\ntd.{name}{_signature(thing)}\n```\n")
        parts.append(_docstring(thing))
    return "\n".join(parts)


def _signature(function: Any) -> str:
    signature = inspect.signature(function)
    line = str(signature).replace("'", "")
    if len(line) < 100:
        return line
    arguments = [str(parameter).replace("'", "") for parameter in signature.parameters.values()]
    stars = [n for n, parameter in enumerate(signature.parameters.values()) if parameter.kind == parameter.KEYWORD_ONLY]
    if stars and "*" not in "".join(arguments[: stars[0]]):
        arguments.insert(stars[0], "*")
    inside = "".join(f"    {argument},\n" for argument in arguments)
    return f"(\n{inside}) -> {str(signature.return_annotation).strip(chr(39))}"


def _docstring(thing: Any) -> str:
    """A docstring as Markdown: its sections become lists."""
    text = inspect.getdoc(thing) or ""
    text = re.sub(r"``([^`]+)``", r"`\1`", text)
    lines = []
    for block in text.split("\n\n"):
        head, _, body = block.partition("\n")
        if head in ("Args:", "Returns:", "Raises:", "Attributes:"):
            lines.append(f"{head[:-1]}:\n")
            entries = re.split(r"\n(?=    \S)", body) if head != "Returns:" else [body]
            for entry in entries:
                name, colon, said = " ".join(entry.split()).partition(": ")
                named = colon and re.fullmatch(r"\*{0,2}\w+", name)
                lines.append(f"- `{name}`: {_cell(said)}" if named else f"- {_cell(' '.join(entry.split()))}")
            lines.append("")
        elif block.startswith(">>>"):
            lines += ["```python", block, "```", ""]
        else:
            lines += [_cell(block), ""]
    return "\n".join(lines)


def http() -> str:
    """Every route of the interface, with a call and the formats of its body and its answer."""
    with tempfile.TemporaryDirectory() as folder:
        app = create_app(Settings(Path(folder), token="token", workers=0))
        description = app.openapi()
    parts = ["# HTTP\n", _NOTE, _HTTP]
    for path, methods in description["paths"].items():
        for method, route in methods.items():
            name = f"{method.upper()} {path.removeprefix('/api/v1')}"
            parts.append(f"## {name}\n")
            said = route.get("description") or route.get("summary", "")
            parts.append(_cell(re.sub(r"``([^`]+)``", r"`\1`", said)) + "\n")
            given = [
                (f"`{item['name']}`", item["in"], *_format(item["schema"], item.get("description", "")))
                for item in route.get("parameters", ())
                if item["in"] != "path" or "description" in item
            ]
            body = route.get("requestBody", {"content": {"application/json": {"schema": {}}}})
            fields = body["content"]["application/json"]["schema"].get("properties", {})
            given += [(f"`{field}`", "body", *_format(entry)) for field, entry in fields.items()]
            if given:
                parts.append(
                    _table(("parameter", "in", "type", "default", "meaning"), [map(_cell, row) for row in given])
                )
            parts.append(f"```sh\n{_EXAMPLES[name]['curl'].strip()}\n```\n")
            parts += _answers(route["responses"], _EXAMPLES[name])
    parts.append("## Objects\n")
    for name, schema in description["components"]["schemas"].items():
        if fields := schema.get("properties"):
            rows = [(f"`{field}`", *_format(entry)) for field, entry in fields.items()]
            parts.append(f"### {name}\n\n{schema.get('description', '')}\n")
            parts.append(_table(("field", "type", "default", "meaning"), [map(_cell, row) for row in rows]))
    return "\n".join(parts)


def _answers(responses: Mapping[str, Any], example: Mapping[str, Any]) -> Iterator[str]:
    """The answer of a route with its format, an example of an object without fields of its own, and the refusals."""
    codes = sorted(code for code in responses if code.isdigit())
    good, bad = ([code for code in codes if (code < "400") == well] for well in (True, False))
    content = responses[good[-1]].get("content", {})
    forms = [
        _type(entry.get("schema", {})) if form == "application/json" else f"`{form}`" for form, entry in content.items()
    ]
    forms = [form or "JSON" for form in forms]
    shown = f": {', '.join(forms)}" if forms else ""
    called = f" This call is refused for the run above: {example['status']}." if example.get("status", 0) >= 400 else ""
    yield f"Answers {', '.join(good)}{shown}. Refusals: {', '.join(bad)}, with [Errors](#errors).{called}\n"
    if "answer" in example:
        yield f"```json\n{example['answer'].strip()}\n```\n"


def _format(entry: Mapping[str, Any], said: str = "") -> tuple[str, str, str]:
    """Type, default and meaning of a field."""
    return _type(entry), _default(entry), said or entry.get("description", "")


def _type(entry: Mapping[str, Any]) -> str:
    """The type of a value of JSON in words; an object with fields of its own leads to them."""
    if reference := entry.get("$ref"):
        name = reference.rpartition("/")[2]
        return "text" if name == "State" else f"[{name}](#{name.lower()})"
    if words := entry.get("enum"):
        return ", ".join(f"`{word}`" for word in words)
    if parts := entry.get("anyOf"):
        return " or ".join(dict.fromkeys(filter(None, map(_type, parts))))
    kind = entry.get("type", "")
    if kind == "array":
        return f"list of {_type(entry.get('items', {})) or 'value'}s".replace("texts", "text").replace(")s", ")")
    if kind == "object" and isinstance(inside := entry.get("additionalProperties"), Mapping) and _type(inside):
        return f"object of {_type(inside)}s".replace("texts", "text")
    return {"string": "text", "integer": "whole number", "boolean": "true or false"}.get(kind, kind)


def _first_sentence(thing: Any) -> str:
    return (inspect.getdoc(thing) or "").split("\n\n")[0].replace("\n", " ")


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:] + "."


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("<", "&lt;")


def _table(heads: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    heads = tuple(heads)
    lines = [heads, tuple("---" for _ in heads), *rows]
    return "\n".join("| " + " | ".join(" ".join(cell.split()) for cell in line) + " |" for line in lines) + "\n"


PAGES = {
    "commands.md": commands,
    "file_keys.md": file_keys,
    "parameters_and_outputs.md": parameters_and_outputs,
    "python_names.md": python,
    "http.md": http,
}
"""What writes each page."""


def texts() -> dict[str, str]:
    """All generated pages by name."""
    return {name: re.sub(r"\n{3,}", "\n\n", page()).rstrip() + "\n" for name, page in PAGES.items()}


if __name__ == "__main__":
    for name, text in texts().items():
        (_HERE / name).write_text(text, encoding="utf-8")
