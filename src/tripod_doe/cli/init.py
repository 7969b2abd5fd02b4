"""Write a study file to start from."""

import argparse
import sys
from collections.abc import Sequence

from tripod_doe.cli.parser import DONE, Command, Parser
from tripod_doe.study.definition.template import TEMPLATES


def _add_arguments(parser: Parser, arguments: Sequence[str]) -> None:
    parser.add_argument("name", metavar="NAME", nargs="?", default="study", help="name of the study (default study)")
    parser.add_argument(
        "--kind",
        choices=TEMPLATES,
        default="grid",
        help="kind of study: a grid (default), which parameter matters, which friction, effects and "
        "curvature from few points, tolerances, a page to play with, or several models",
    )


def _run(options: argparse.Namespace) -> int:
    from tripod_doe.study.definition.template import write_template

    path = write_template(options.name, options.kind)
    print(path)
    print(f"next: tripod-doe plan {path}", file=sys.stderr)
    return DONE


COMMAND = Command("write a study file to start from", _add_arguments, _run)
