"""Checks of the code base: layers, types, style, names, and that everything public has a docstring."""

from __future__ import annotations

import ast
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import tripod_doe as td
from tripod_doe.cli.main import build_parser
from tripod_doe.joint.models.registry import MODELS
from tripod_doe.joint.simulator import simulator
from tripod_doe.mechanics.compilation.sources import cache_root
from tripod_doe.study.definition.study_file_schema import StudyFile

ROOT = Path(__file__).parent.parent
SOURCES = sorted((ROOT / "src").rglob("*.py"))


def expect_success(name, *arguments, **environment):
    command = [str(Path(sys.executable).with_name(name)), *arguments]
    done = subprocess.run(command, cwd=ROOT, env=os.environ | environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr


def test_imports_run_one_way():
    expect_success("lint-imports")


@pytest.mark.slow
def test_types_are_strict():
    """What is known of unchanged modules, which takes half a minute, is kept beside the compiled kernels."""
    expect_success("mypy", MYPY_CACHE_DIR=str(cache_root() / "mypy"))


def test_expressions_are_read_alike_by_all_releases():
    """Possessive repeats (`*+`) give wrong matches in Python 3.11.2."""
    for path in SOURCES:
        calls = [node for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.Call) and node.args]
        of_re = [call.args[0] for call in calls if ast.unparse(call.func).startswith("re.")]
        texts = ["".join(map(written, getattr(word, "values", [word]))) for word in of_re]
        assert not [text for text in texts if "POSSESSIVE" in str(re._parser.parse(text).data)], path


def written(part):
    """Part of an expression as its source writes it; a count in place of what an f-string puts in."""
    if not isinstance(part, ast.Constant):
        return "2"
    return part.value.decode("latin-1") if isinstance(part.value, bytes) else part.value


def test_style():
    expect_success("ruff", "check", ".")
    expect_success("ruff", "format", "--check", ".")


def test_modules_are_of_one_size_and_named_for_what_they_do():
    for path in SOURCES:
        assert path.stem not in {"utils", "util", "helpers", "common", "core", "base", "misc"}, path
        assert len(path.read_text().splitlines()) <= 500, path


def test_a_constant_has_one_value():
    """A second one of the same name, further down in a module, would be that of all functions."""
    for path in SOURCES:
        body = ast.parse(path.read_text()).body
        assigned = [target for node in body if isinstance(node, ast.Assign) for target in node.targets]
        each = [name for target in assigned for name in getattr(target, "elts", [target])]
        names = [name.id for name in each if isinstance(name, ast.Name)]
        assert sorted(names) == sorted(set(names)), path


def test_public_names_are_where_they_say():
    assert sorted(td.__all__) == sorted(td._HOME)
    for name in td.__all__:
        assert getattr(td, name).__doc__, name


def test_every_public_function_has_a_docstring():
    for path in SOURCES:
        tree = ast.parse(path.read_text())
        places = [tree, *(node for node in tree.body if isinstance(node, ast.ClassDef))]
        for node in (inner for place in places for inner in place.body):
            if isinstance(node, ast.FunctionDef | ast.ClassDef) and not node.name.startswith("_"):
                assert ast.get_docstring(node), f"{path}: {node.name}"


def test_every_parameter_and_output_says_what_it_is():
    for parameter in simulator.parameters.values():
        assert parameter.meaning, parameter.name
        assert parameter.source, parameter.name
        assert re.search(r"paper|assumed|steel|numerics", parameter.source), parameter.name
        if parameter.default is not None:
            assert parameter.check(parameter.default) == parameter.default
    for output in simulator.outputs.values():
        assert output.meaning, output.name
        assert output.unit, output.name
    for model in MODELS.values():
        assert model.ignores <= set(simulator.parameters)
        assert model.outputs <= set(simulator.outputs)


def test_every_key_of_a_study_file_is_described():
    schema = StudyFile.model_json_schema()
    for name, table in schema["$defs"].items():
        for key, entry in table["properties"].items():
            assert entry.get("description"), f"{name}.{key}"


def test_every_flag_has_help():
    parsers = build_parser(["simulate"])._subparsers._group_actions[0].choices
    for command, parser in parsers.items():
        for action in parser._actions:
            assert action.help, f"{command} {action.option_strings or action.dest}"
