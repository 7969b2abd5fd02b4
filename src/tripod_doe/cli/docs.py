"""Print where the documentation is on this machine, or open it."""

import argparse
import webbrowser
from collections.abc import Sequence

from tripod_doe.cli.parser import DONE, Command, Parser
from tripod_doe.documentation import BUILD, INSTALL, site_folder
from tripod_doe.errors import InputError


def _add_arguments(parser: Parser, arguments: Sequence[str]) -> None:
    parser.add_argument("--open", action="store_true", help="open it in the browser")


def _run(options: argparse.Namespace) -> int:
    site = site_folder()
    if site is None:
        raise InputError(
            "docs: this installation has none: it is an editable one, or Sphinx was missing when it was made; "
            "in the folder of the repository, run: "
            f"{INSTALL} && {BUILD}"
        )
    page = site / "index.html"
    print(page)
    if options.open:
        webbrowser.open(page.as_uri())
    return DONE


COMMAND = Command("print the path of the documentation, which needs no network", _add_arguments, _run)
