"""Print the schema of study, workflow or fit files."""

import argparse
import json
from collections.abc import Sequence

from tripod_doe.cli.parser import DONE, Command, Parser
from tripod_doe.errors import InputError


def _add_arguments(parser: Parser, arguments: Sequence[str]) -> None:
    parser.add_argument("kind", choices=("study", "workflow", "fit"), help="kind of file")
    parser.add_argument("--scene", default="joint", metavar="S", help="scene whose parameters are listed")
    parser.add_argument("--brief", action="store_true", help="one readable line per key, parameter and output")


def _run(options: argparse.Namespace) -> int:
    if options.kind != "study" and options.brief:
        raise InputError("--brief: only for study files")
    if options.kind == "workflow":
        from tripod_doe.workflow.workflow_file import workflow_schema

        print(json.dumps(workflow_schema(), indent=1))
        return DONE
    if options.kind == "fit":
        from tripod_doe.analyses.fit.fit_file import fit_schema

        print(json.dumps(fit_schema(), indent=1))
        return DONE
    from tripod_doe.study.definition.json_schema import brief_schema, study_schema

    print(brief_schema(options.scene) if options.brief else json.dumps(study_schema(options.scene), indent=1))
    return DONE


COMMAND = Command("print the schema of study, workflow or fit files", _add_arguments, _run)
