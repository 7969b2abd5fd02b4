"""Write a study file to start from, or the example files of the documentation."""

import argparse
import shlex
import sys
from collections.abc import Sequence

from tripod_doe.cli.parser import DONE, Command, Parser
from tripod_doe.study.definition.template import TEMPLATES

_EXAMPLES = "examples"


def _add_arguments(parser: Parser, arguments: Sequence[str]) -> None:
    parser.add_argument(
        "name",
        metavar="NAME",
        nargs="?",
        help="name of the study (default study); of examples, the folder (default: the current one)",
    )
    parser.add_argument(
        "--kind",
        choices=(*TEMPLATES, _EXAMPLES),
        default="grid",
        help="kind of study: a grid (default), which parameter matters, which friction, effects and "
        "curvature from few points, tolerances, a page to play with, or several models; examples: the studies, "
        "workflows, optimisations and records that the documentation names",
    )


def _run(options: argparse.Namespace) -> int:
    from tripod_doe.study.definition.template import write_examples, write_template

    if options.kind == _EXAMPLES:
        print(*write_examples(options.name or "."), sep="\n")
        return DONE
    path = write_template(options.name or "study", options.kind)
    print(path)
    print(f"next: tripod-doe plan {shlex.quote(str(path))}", file=sys.stderr)
    return DONE


COMMAND = Command("write a study file to start from, or the examples of the documentation", _add_arguments, _run)
