"""Write the page of a result directory again."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from tripod_doe.cli.parser import DONE, Command, Parser


def _add_arguments(parser: Parser, arguments: Sequence[str]) -> None:
    parser.add_argument("directory", metavar="DIR", type=Path, help="result directory")


def _run(options: argparse.Namespace) -> int:
    from tripod_doe.pages.fit import write_fit_page
    from tripod_doe.pages.study import write_report
    from tripod_doe.study.results.result_cube import FIT_FILE, open_cube

    if (options.directory / FIT_FILE).is_file():
        print(write_fit_page(options.directory, open_cube(options.directory)))
    else:
        print(write_report(options.directory))
    return DONE


COMMAND = Command("write the report of a result directory again", _add_arguments, _run)
