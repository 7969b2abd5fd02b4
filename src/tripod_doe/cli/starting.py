"""Commands to start from: init, schema, completion."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence

from tripod_doe.cli.parser import (
    DONE,
    Command,
    Parser,
)
from tripod_doe.errors import InputError
from tripod_doe.study.template import TEMPLATES


def _add_init(parser: Parser, arguments: Sequence[str]) -> None:
    parser.add_argument("name", metavar="NAME", nargs="?", default="study", help="name of the study (default study)")
    parser.add_argument(
        "--kind",
        choices=TEMPLATES,
        default="grid",
        help="kind of study: a grid (default), which parameter matters, which friction, effects and "
        "curvature from few points, tolerances, a page to play with, or several models",
    )


def _add_schema(parser: Parser, arguments: Sequence[str]) -> None:
    parser.add_argument("kind", choices=("study", "workflow"), help="kind of file")
    parser.add_argument("--scene", default="joint", metavar="S", help="scene whose parameters are listed")
    parser.add_argument("--brief", action="store_true", help="one readable line per key, parameter and output")


def _add_completion(parser: Parser, arguments: Sequence[str]) -> None:
    parser.add_argument("shell", choices=("bash", "zsh"), help="shell that reads it")


def _init(options: argparse.Namespace) -> int:
    from tripod_doe.study.template import write_template

    path = write_template(options.name, options.kind)
    print(path)
    print(f"next: tripod-doe plan {path}", file=sys.stderr)
    return DONE


def _schema(options: argparse.Namespace) -> int:
    if options.kind == "workflow":
        from tripod_doe.workflow.file import workflow_schema

        if options.brief:
            raise InputError("--brief: only for study files")
        print(json.dumps(workflow_schema(), indent=1))
        return DONE
    from tripod_doe.study.schema import brief_schema, study_schema

    print(brief_schema(options.scene) if options.brief else json.dumps(study_schema(options.scene), indent=1))
    return DONE


def _completion(options: argparse.Namespace) -> int:
    from tripod_doe.cli.completion import completion_script
    from tripod_doe.cli.main import build_parser  # which knows this module

    print(completion_script(build_parser(["simulate"]), options.shell))  # with the flags of its parameters
    return DONE


COMMANDS = {
    "init": Command("write a study file to start from", _add_init, _init),
    "schema": Command("print the schema of study or workflow files", _add_schema, _schema),
    "completion": Command("print a script that completes commands in a shell", _add_completion, _completion),
}
