"""Write a page that moves the joint at one or two points of a study's results."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tripod_doe.cli.parser import DONE, Command, Parser, add_selection, parameter_value
from tripod_doe.errors import InputError, near_match


def _add_arguments(parser: Parser, arguments: Sequence[str]) -> None:
    parser.add_argument("directory", metavar="DIR", type=Path, help="result directory of a study of the joint")
    add_selection(parser, "a value of a factor")
    add_against(parser)
    parser.add_argument("--output", metavar="FILE.html", type=Path, required=True, help="the page to write")


def _run(options: argparse.Namespace) -> int:
    from tripod_doe.files.atomic_files import replace_text

    replace_text(options.output, moved_points(options))
    print(f"view    {options.output}", file=sys.stderr)
    return DONE


def moved_points(options: argparse.Namespace) -> str:
    """The page that animates one or two points of a study, which are simulated again."""
    from tripod_doe.motion_page.page import motion_page, viewed_point
    from tripod_doe.motion_page.stored_points import points_in

    points, changes = points_in(options.directory, options.select, options.nearest), against(options.against)
    if changes and len(points) > 1:
        raise InputError("--against: the selection leaves two points, which are shown side by side; select one")
    others = [points[0] | changes] if changes else []
    return motion_page(*(viewed_point(**each) for each in (*points, *others)))


def add_against(parser: Parser, needs: str = "") -> None:
    """Add the flag that shows a second point next to the first; `needs` begins its help."""
    parser.add_argument(
        "--against",
        metavar="NAME=VALUE",
        action="append",
        default=[],
        help=f"{needs}also show the same joint with another value, for instance torque_n_m=-50; may be repeated",
    )


def against(texts: Sequence[str]) -> dict[str, Any]:
    """The values of a second point by their names."""
    from tripod_doe.study.definition.simulators import load_simulator

    known, values = load_simulator().parameters, dict[str, Any]()
    for text in texts:
        name, equal, value = text.partition("=")
        name = name.strip().replace("-", "_")
        if not equal:
            raise InputError(f"--against {text}: write NAME=VALUE, as torque_n_m=-50")
        if name not in known:
            raise InputError(f"--against {text}: unknown parameter{near_match(name, known)}")
        values[name] = parameter_value(known[name], value.strip(), "against")
    return values


COMMAND = Command("write a page that moves the joint at one or two points of a study", _add_arguments, _run)
