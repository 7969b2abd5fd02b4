"""Simulate one point; the parameters of the scene are flags."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tripod_doe.cli.parser import DONE, SOME_FAILED, Command, Parser, add_format, parameter_value
from tripod_doe.cli.view import add_against, against
from tripod_doe.errors import InputError, near_match
from tripod_doe.number_text import duration

if TYPE_CHECKING:
    from tripod_doe.model_interface import Simulator
    from tripod_doe.study.simulate import SimulatedPoint

_VARYING = ("factors", "variables", "unknowns", "at")  # tables of studies, optimisations and fits
_LONG = 1.0  # CPU seconds of a point above which its price is printed first


def _add_arguments(parser: Parser, arguments: Sequence[str]) -> None:
    """Add flags; the scene's parameters become flags only if `simulate` is called, since they need slow imports."""
    scene = parser.add_argument("--scene", default="joint", metavar="S")
    scene.help = "what to simulate (default joint)"
    add_format(parser)
    parser.add_argument(
        "--base",
        metavar="FILE.toml",
        type=Path,
        help="take the values of this file, for instance a study: those in [base], and factors with one value; "
        "flags override them, and are needed for parameters that the file varies",
    )
    parser.add_argument(
        "--variable",
        metavar="NAME",
        action="append",
        help="print only this output, which may be one that is computed only on request; may be repeated",
    )
    parser.add_argument("--view", metavar="FILE.html", type=Path, help="also write a page that moves the joint")
    add_against(parser, "with --view: ")
    if "simulate" in arguments[:1]:
        from tripod_doe.study.definition.simulators import SCENES, load_simulator

        scene.help = f"what to simulate: {', '.join(SCENES)} (default joint)"
        _add_parameters(parser, load_simulator(_scene_named_in(arguments)))


def _scene_named_in(arguments: Sequence[str]) -> str:
    """The scene in the call, read before parsing, since it decides which flags exist."""
    finder = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    finder.add_argument("--scene", default="joint")
    return str(finder.parse_known_args(list(arguments))[0].scene)


def _add_parameters(parser: argparse.ArgumentParser, simulator: Simulator) -> None:
    groups: dict[str, Any] = {}
    for parameter in simulator.parameters.values():
        group = groups.setdefault(parameter.group, parser.add_argument_group(parameter.group))
        text = f"{parameter.meaning} ({parameter.unit_text + '; ' if parameter.unit_text else ''}{parameter.range_text}"
        text += f"; default {parameter.default}" if parameter.default is not None else ""
        group.add_argument(
            "--" + parameter.name.replace("_", "-"),
            dest=parameter.name,
            metavar=parameter.symbol or "VALUE",
            help=text.replace("%", "%%") + f"; {parameter.source})",
        )


def _run(options: argparse.Namespace) -> int:
    from tripod_doe.model_interface import Outcome
    from tripod_doe.study.definition.simulators import load_simulator
    from tripod_doe.study.point_table import point_table
    from tripod_doe.study.simulate import simulate_point, usual_price

    simulator = load_simulator(options.scene)
    given = {
        name: parameter_value(parameter, getattr(options, name), name.replace("_", "-"))
        for name, parameter in simulator.parameters.items()
        if getattr(options, name) is not None
    }
    given = (_file_values(options.base, simulator, given) if options.base else {}) | given
    if options.against and not options.view:
        raise InputError(
            f"--against {options.against[0]}: shows a second joint next to the first on a page; add --view joint.html"
        )
    price = usual_price(options.scene, **given)
    if price is not None and price >= _LONG:
        usual = f"about {duration(price, 2)} of CPU time for a usual point, up to twenty times as much for others"
        print(f"simulating: {usual}", file=sys.stderr)
    chosen = _chosen(simulator, options.variable)
    point = _viewed(options, given) if options.view else simulate_point(options.scene, chosen, **given)
    if point.outcome is Outcome.FINISHED and (lacking := [name for name in chosen if name not in point.outputs]):
        print(f"No value of {', '.join(lacking)}: this model does not compute it.", file=sys.stderr)
    point = point.only(chosen) if chosen else point.usual()
    print(json.dumps(point.record(chosen), allow_nan=False) if options.format == "json" else point_table(point))
    return DONE if point.outcome is Outcome.FINISHED else SOME_FAILED


def _file_values(path: Path, simulator: Simulator, given: Collection[str]) -> dict[str, Any]:
    """The values of one point that a file states: [base], and factors with one value.

    Raises:
        InputError: If a value is wrong, or the file varies a parameter that is not given as a flag.
    """
    from tripod_doe.model_interface import check_parameters
    from tripod_doe.study.definition.toml_text import parse_toml, read_text

    tables = parse_toml(read_text(path, "file"), str(path))
    study = tables.get("study")
    scene = study.get("scene", "joint") if isinstance(study, dict) else simulator.name
    if scene != simulator.name:
        raise InputError(f"--base {path}: this file is of another scene: add --scene {scene}")
    base, varied = tables.get("base", {}), _varied(tables, simulator.parameters)
    if not isinstance(base, dict) or not (base or varied):
        raise InputError(f"--base {path}: this file has no table [base]")
    base = {name: value for name, value in base.items() if name not in given}
    if base.get("model") == "auto":  # a pilot of the study chooses
        varied["model"] = [base.pop("model")] * 2
    single = {name: levels[0] for name, levels in varied.items() if len(levels) == 1}
    flags = ["--" + name.replace("_", "-") for name in varied if name not in {*single, *base, *given}]
    if flags:
        raise InputError(f"--base {path}: simulate computes one point, and this file varies: give {' '.join(flags)}")
    try:
        return dict(check_parameters(simulator.parameters, single | base))
    except InputError as error:
        raise error.at(f"{path}: [base]") from error


def _varied(tables: Mapping[str, Any], known: Collection[str]) -> dict[str, list[Any]]:
    """By name, the listed values of each parameter that a file varies; empty for a range."""
    groups = [tables.get(name) for name in _VARYING]
    rows = {name: row for group in groups if isinstance(group, dict) for name, row in group.items() if name in known}
    levels = {name: row.get("values") if isinstance(row, dict) else None for name, row in rows.items()}
    return {name: own if isinstance(own, list) else [] for name, own in levels.items()}


def _chosen(simulator: Simulator, names: Sequence[str] | None) -> list[str]:
    """The outputs to print; the scene must have each of them."""
    for name in names or ():
        if name not in simulator.outputs:
            near = near_match(name, simulator.outputs)
            raise InputError(f"--variable {name}: the scene {simulator.name} has no such output{near}")
    return list(names or ())


def _viewed(options: argparse.Namespace, given: dict[str, Any]) -> SimulatedPoint:
    """Simulate the point, and write its page if it finishes."""
    from tripod_doe.files.atomic_files import replace_text
    from tripod_doe.model_interface import Outcome
    from tripod_doe.motion_page.page import motion_page, viewed_point

    if options.scene != "joint":
        raise InputError(f"--view {options.view}: only the scene joint can be viewed, not {options.scene}")
    changes = against(options.against)
    points = [viewed_point(**each) for each in ([given, {**given, **changes}] if changes else [given])]
    if all(point.outcome is Outcome.FINISHED for point in points):
        replace_text(options.view, motion_page(*points))
    else:
        print(f"{options.view}: not written, since the point has no motion to show", file=sys.stderr)
    return points[0]


COMMAND = Command("simulate one point", _add_arguments, _run)
