"""Write a page that moves the joint at one point of a study's results."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from tripod_doe.cli.parser import DONE, Command, Parser, add_selection


def _add_arguments(parser: Parser, arguments: Sequence[str]) -> None:
    parser.add_argument("directory", metavar="DIR", type=Path, help="result directory of a study of the joint")
    add_selection(parser, "a value of a factor")
    parser.add_argument("--output", metavar="FILE.html", type=Path, required=True, help="the page to write")


def _run(options: argparse.Namespace) -> int:
    from tripod_doe.motion.page import motion_page, viewed_point, write_page
    from tripod_doe.motion.stored_point import point_in

    values = point_in(options.directory, options.select, options.nearest)
    page = motion_page(viewed_point(**values))
    write_page(page, options.output, "--output")
    print(f"view    {options.output}", file=sys.stderr)
    return DONE


COMMAND = Command("write a page that moves the joint at a point of a study", _add_arguments, _run)
