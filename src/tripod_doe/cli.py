"""The command line: run, plan, query, simulate, report, workflow, compare, schema, init, completion.

Answers go to standard output; progress and messages go to standard error. Exit codes: 0 done, 1 internal error,
2 wrong call or input (nothing started), 3 done, but something failed that was not expected, 130 interrupted.
"""

from __future__ import annotations

import argparse
import json
import logging
import math
import sys
import traceback
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from tripod_doe.errors import InputError, TripodDoeError, near_match, speaking_of_options
from tripod_doe.interrupts import INTERRUPTED, check_interrupt, leave_interrupted, take_interrupts
from tripod_doe.quantities import count_of, duration, pace

if TYPE_CHECKING:  # imports of a command stand in its function: each loads only what it needs
    from tripod_doe.simulator import Parameter, Simulator
    from tripod_doe.study.simulate import SimulatedPoint

__all__ = ["main"]

DONE, INTERNAL, WRONG_INPUT, SOME_FAILED = 0, 1, 2, 3


class _Parser(argparse.ArgumentParser):
    """An argument parser that accepts - and _ alike and names the nearest known flag."""

    def __init__(self, **options: Any) -> None:
        super().__init__(**(options | {"allow_abbrev": False}))

    def refuse(self, word: str) -> NoReturn:
        """Refuse a word that the command does not take."""
        flag = word.partition("=")[0]
        flags = [flag for action in self._actions for flag in action.option_strings]
        unknown = f"unknown flag {flag}{near_match(flag, flags)}"
        self.error(unknown if flag.startswith("-") else f"unexpected argument {word!r}")

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        """Refuse a word that is none of an argument's choices, with the nearest one (argparse only lists them)."""
        if action.choices is not None and value not in action.choices:
            raise argparse.ArgumentError(action, f"invalid choice: {value!r}{near_match(str(value), action.choices)}")

    def error(self, message: str) -> NoReturn:
        """Print the message and where to look, and leave with exit code 2."""
        print(f"{self.prog}: {message}", file=sys.stderr)
        print(f"try: {self.prog} --help", file=sys.stderr)
        raise SystemExit(WRONG_INPUT)


class _Version(argparse.Action):
    """Print the version, which is looked up only when it is asked for."""

    def __call__(self, *call: Any) -> NoReturn:
        from importlib.metadata import version

        print(f"tripod-doe {version('tripod-doe')}")
        raise SystemExit(DONE)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line, that of this process unless words are given; returns the exit code."""
    with speaking_of_options():
        if arguments is not None:
            return _run_command([_dashes(word) for word in arguments])
        take_interrupts()
        code = _run_command([_dashes(word) for word in sys.argv[1:]])
    leave_interrupted()
    return code


def _run_command(arguments: Sequence[str]) -> int:
    """Run a command; report errors on standard error, and return the exit code."""
    try:
        options, unknown = _parser(arguments).parse_known_args(arguments)
        if unknown:
            options.parser.refuse(unknown[0])
        code = int(options.command(options))
        check_interrupt()
        return code
    except SystemExit as stop:
        return int(stop.code or 0)
    except InputError as error:
        print(f"tripod-doe: {error}", file=sys.stderr)
        return WRONG_INPUT
    except TripodDoeError as error:
        print(f"tripod-doe: {error}", file=sys.stderr)
        return INTERNAL
    except KeyboardInterrupt:
        print(
            "tripod-doe: interrupted; finished points are kept: run again to continue, or report DIR to see them",
            file=sys.stderr,
        )
        return INTERRUPTED
    except BrokenPipeError:  # the reader of our output has seen enough
        sys.stderr.close()
        return DONE
    except Exception:
        traceback.print_exc()
        print("tripod-doe: internal error (please report it with the lines above)", file=sys.stderr)
        return INTERNAL


def _dashes(word: str) -> str:
    """``--joint_angle_deg=5`` as ``--joint-angle-deg=5``; values keep their underscores."""
    if not word.startswith("--"):
        return word
    flag, equals, value = word.partition("=")
    return flag.replace("_", "-") + equals + value


@dataclass(frozen=True)
class _Command:
    """One word of the command line: its line of help, the function that adds its arguments, and the one that runs it.

    The latter takes the parsed options and returns the exit code; it imports what it needs when it is called.
    """

    help: str
    add_arguments: Callable[[_Parser, Sequence[str]], None]
    run: Callable[[argparse.Namespace], int]


def _parser(arguments: Sequence[str]) -> _Parser:
    """The parser of all commands; the words of the call decide which scene's parameters are flags of `simulate`."""
    parser = _Parser(prog="tripod-doe", description="Parameter studies for the thrust force of tripod joints.")
    parser.add_argument("--version", action=_Version, nargs=0, help="print the version")
    parsers = parser.add_subparsers(required=True, metavar="COMMAND", parser_class=_Parser)
    for name, command in _COMMANDS.items():
        own = parsers.add_parser(name, help=command.help, description=command.help)
        command.add_arguments(own, arguments)
        own.set_defaults(command=command.run, parser=own)
    return parser


def _add_study(parser: _Parser) -> None:
    parser.add_argument("study", metavar="STUDY.toml", type=Path, help="study file")


def _add_cube(parser: _Parser) -> None:
    parser.add_argument("cube", metavar="DIR|CUBE.nc", type=Path, help="result directory or cube")


def _add_out(parser: _Parser) -> None:
    parser.add_argument("--out", metavar="DIR", type=Path, required=True, help="result directory")


def _add_format(parser: _Parser, *others: str) -> None:
    parser.add_argument("--format", choices=("table", "json", *others), default="table", help="output format")


def _add_selection(parser: _Parser, text: str) -> None:
    parser.add_argument("--select", metavar="NAME=VALUE", action="append", default=[], help=f"{text}; may be repeated")
    parser.add_argument("--nearest", action="store_true", help="take the nearest value where none matches")


def _add_oversubscribe(parser: _Parser) -> None:
    parser.add_argument("--oversubscribe", action="store_true",
                        help="start all --workers, also more than this machine has processors")  # fmt: skip


def _add_run(parser: _Parser, arguments: Sequence[str]) -> None:
    _add_study(parser)
    _add_out(parser)
    parser.add_argument("--workers", metavar="N", type=int,
                        help="worker processes; 0: compute in this process (default: 0 for studies of a few seconds, "
                        "else 2)")  # fmt: skip
    _add_oversubscribe(parser)
    parser.add_argument("--scheduler", metavar="ADDRESS", help="address of a running Dask scheduler to use")
    parser.add_argument("--retry-failed", action="store_true", help="run failed points again")
    parser.add_argument("--fail-fast", action="store_true", help="stop at the first point that fails unexpectedly")


def _add_plan(parser: _Parser, arguments: Sequence[str]) -> None:
    _add_study(parser)
    parser.add_argument("--no-timing", action="store_true", help="count points and bytes only, without timing")
    parser.add_argument("--out", metavar="DIR", type=Path,
                        help='for a study with model = "auto": result directory whose choice to show')  # fmt: skip
    parser.add_argument("--workers", metavar="N", type=int, default=2, help="worker processes to plan for (default 2)")


def _add_query(parser: _Parser, arguments: Sequence[str]) -> None:
    _add_cube(parser)
    parser.add_argument("--variable", metavar="NAME", required=True, help="variable to print")
    _add_selection(parser, "a value, a list a,b,c or a range a:b of a coordinate")
    parser.add_argument("--where", metavar="EXPR", help="condition on coordinates, variables and outcome")
    parser.add_argument("--format", choices=("table", "json", "csv", "netcdf"),
                        help="output format (default: as --output is named, else table)")  # fmt: skip
    parser.add_argument("--output", metavar="FILE", type=Path,
                        help="write to this file instead of standard output; its ending decides the format: .csv, "
                        ".json, .nc or .txt")  # fmt: skip


def _add_simulate(parser: _Parser, arguments: Sequence[str]) -> None:
    """The parameters of the scene are flags; they are added only where `simulate` is called, as they take imports."""
    scene = parser.add_argument("--scene", default="joint", metavar="S")
    scene.help = "what to simulate (default joint)"
    _add_format(parser)
    if "simulate" in arguments[:1]:
        from tripod_doe.study.scenes import SCENES, load_simulator

        scene.help = f"what to simulate: {', '.join(SCENES)} (default joint)"
        _add_parameters(parser, load_simulator(_scene_named_in(arguments)))


def _add_report(parser: _Parser, arguments: Sequence[str]) -> None:
    parser.add_argument("directory", metavar="DIR", type=Path, help="result directory")


def _add_workflow(parser: _Parser, arguments: Sequence[str]) -> None:
    parser.add_argument("file", metavar="FILE.toml", type=Path, help="workflow file")
    _add_out(parser)
    parser.add_argument("--only", metavar="STEP", help="run only this step and the steps that it needs")
    parser.add_argument("--quick", action="store_true", help="apply the overrides of [quick]: smaller studies")
    parser.add_argument("--workers", metavar="N", type=int,
                        help="worker processes that all studies share; 0: compute in this process (default: 0 for "
                        "studies of a few seconds, else 2)")  # fmt: skip
    _add_oversubscribe(parser)
    parser.add_argument("--retry-failed", action="store_true", help="run failed points again")


def _add_compare(parser: _Parser, arguments: Sequence[str]) -> None:
    _add_cube(parser)
    parser.add_argument("measurement", metavar="MEASUREMENT.csv", type=Path,
                        help="table with thrust_n and rotation_deg, or thrust_n, time_s and tacho")  # fmt: skip
    _add_selection(parser, "the value of a factor, so that one point is left, or the points over speed_rpm")
    parser.add_argument("--column", metavar="NAME=HEADING", action="append", default=[],
                        help="heading in the file of thrust_n, rotation_deg, time_s or tacho; repeatable")  # fmt: skip
    parser.add_argument("--pulses-per-revolution", metavar="N", type=int, default=1,
                        help="rising edges of tacho per revolution (default 1)")  # fmt: skip
    parser.add_argument("--reference-angle", metavar="DEG", type=float,
                        help="rotation angle of the housing at the first rising edge, or at rotation_deg = 0; "
                        "if omitted, the measurement is aligned by the phase of its third order")  # fmt: skip
    parser.add_argument("--speeds", metavar="LOW:HIGH", help="use only revolutions within this range of speed, rpm")
    _add_format(parser)
    parser.add_argument("--output", metavar="FILE|DIR", type=Path,
                        help="write a report page: FILE.html, or DIR/index.html with DIR/comparison.nc")  # fmt: skip


def _add_schema(parser: _Parser, arguments: Sequence[str]) -> None:
    parser.add_argument("kind", choices=("study", "workflow"), help="kind of file")
    parser.add_argument("--scene", default="joint", metavar="S", help="scene whose parameters are listed")
    parser.add_argument("--brief", action="store_true", help="one line per key, parameter and output, to be read")


def _add_init(parser: _Parser, arguments: Sequence[str]) -> None:
    parser.add_argument("name", metavar="NAME", nargs="?", default="study", help="name of the study (default study)")
    parser.add_argument("--kind", choices=("grid", "sensitivity", "contribution"), default="grid",
                        help="kind of study: a grid (default), which parameter matters, or which friction")  # fmt: skip


def _add_completion(parser: _Parser, arguments: Sequence[str]) -> None:
    parser.add_argument("shell", choices=("bash", "zsh"), help="shell that reads it")


def _scene_named_in(arguments: Sequence[str]) -> str:
    """The scene decides which flags exist, so it is looked for before they are parsed."""
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
            "--" + parameter.name.replace("_", "-"), dest=parameter.name, metavar=parameter.symbol or "VALUE",
            help=text.replace("%", "%%") + f"; {parameter.source})",
        )  # fmt: skip


def _parameter_value(parameter: Parameter, text: str) -> Any:
    if parameter.kind == "choice":
        return text
    try:
        return float(text)
    except ValueError as error:
        raise InputError(
            f"--{parameter.name.replace('_', '-')} {text!r}: expected a number ({parameter.range_text})"
        ) from error


def _run(options: argparse.Namespace) -> int:
    from tripod_doe.study.failures import failure_lines
    from tripod_doe.workflow.run import run  # Dask and plotting are slow to import

    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    summary = run(
        options.study, options.out, options.workers, options.scheduler, options.retry_failed, options.fail_fast,
        oversubscribe=options.oversubscribe,
    )  # fmt: skip
    for sentence in [*summary.answers, *summary.findings, *summary.model_notes]:
        print(sentence, file=sys.stderr)
    for name, reason in summary.analyses.items():
        if reason:
            print(f"analysis {name} failed: {reason}", file=sys.stderr)
    for line in failure_lines(summary.failures):
        print(line, file=sys.stderr)
    seconds, count = summary.seconds, summary.computed
    rate = f" in {duration(seconds)} ({pace(count, seconds)})" if count else ""
    print(f"{count_of(count, 'point')} computed{rate}, {summary.reused:,} reused", file=sys.stderr)
    print(f"cube    {summary.directory / 'cube.nc'}", file=sys.stderr)
    print(f"report  {summary.directory / 'report' / 'index.html'}", file=sys.stderr)
    return DONE if summary.good else SOME_FAILED


def _plan(options: argparse.Namespace) -> int:
    from tripod_doe.study.definition import load_study
    from tripod_doe.study.plan import plan

    study = load_study(options.study)
    if study.file.analysis:
        from tripod_doe.workflow.analyses import check_analyses

        check_analyses(study)
    print(plan(study, timing=not options.no_timing).describe(max(options.workers, 1)))
    if study.accuracy:
        from tripod_doe.analysis.model_choice.study_choice import describe_choice

        print(describe_choice(study, options.out))
    return DONE


def _query(options: argparse.Namespace) -> int:
    from tripod_doe.study.arrays import opened_arrays
    from tripod_doe.study.query import answer_format, records, records_text

    form = answer_format(options.format, options.output)
    if form == "netcdf":
        return _query_netcdf(options)
    with opened_arrays(options.cube) as cube:
        columns = records(cube, options.variable, options.select, options.nearest, options.where)
        for note in cube.model_notes:
            print(note, file=sys.stderr)
    text = records_text(columns, form)
    if options.output is None:
        print(text)
        return DONE
    try:
        options.output.write_text(text + "\n", encoding="utf-8")
    except OSError as error:
        raise InputError(f"--output {options.output}: cannot write: {error.strerror}") from error
    return DONE


def _query_netcdf(options: argparse.Namespace) -> int:
    from tripod_doe.study.netcdf import write_dataset
    from tripod_doe.study.query import narrowed, query

    if options.output is None:
        raise InputError("--format netcdf needs --output FILE")
    answer = query(options.cube, options.variable, options.select, options.nearest, options.where)
    write_dataset(narrowed(answer), options.output)
    return DONE


def _simulate(options: argparse.Namespace) -> int:
    from tripod_doe.simulator import Outcome
    from tripod_doe.study.point_table import point_table
    from tripod_doe.study.scenes import load_simulator
    from tripod_doe.study.simulate import simulate_point

    simulator = load_simulator(options.scene)
    given = {
        name: _parameter_value(parameter, getattr(options, name))
        for name, parameter in simulator.parameters.items()
        if getattr(options, name) is not None
    }
    point = simulate_point(options.scene, **given)
    print(json.dumps(_point_answer(point), allow_nan=False) if options.format == "json" else point_table(point))
    return DONE if point.outcome is Outcome.FINISHED else SOME_FAILED


def _point_answer(point: SimulatedPoint) -> dict[str, Any]:
    """A simulated point for programs; outputs are null where the point did not get that far."""
    usual = [name for name, output in point.simulator.outputs.items() if not output.on_request]
    outputs = {name: _plain(values.data.tolist()) for name, values in point.outputs.items()}
    return {
        "scene": point.simulator.name,
        "parameters": point.parameters,
        **(dict.fromkeys(usual) | outputs),
        "coordinates": {name: _plain(labels.tolist()) for name, labels in point.coordinates.items()},
        "outcome": point.outcome.label,
        "outcome_detail": point.detail,
        "model_notes": point.model_notes,
        "cost": point.cost,
    }


def _plain(value: Any) -> Any:
    """Numbers and lists for JSON, NaN as None."""
    if isinstance(value, list):
        return [_plain(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _report(options: argparse.Namespace) -> int:
    from tripod_doe.report.page import write_report

    print(write_report(options.directory))
    return DONE


def _workflow(options: argparse.Namespace) -> int:
    from tripod_doe.workflow.chain import run_workflow

    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    summary = run_workflow(
        options.file, options.out, options.only, options.quick, options.workers, options.retry_failed,
        oversubscribe=options.oversubscribe,
    )  # fmt: skip
    counts = Counter(step.state for step in summary.steps)
    print(", ".join(f"{count} {state}" for state, count in counts.items()), file=sys.stderr)
    print(f"report  {summary.page}", file=sys.stderr)
    return DONE if summary.good else SOME_FAILED


def _compare(options: argparse.Namespace) -> int:
    from tripod_doe.analysis.comparison import compare, model_point, parse_speeds
    from tripod_doe.analysis.measurement import read_measurement
    from tripod_doe.analysis.record_file import parse_column
    from tripod_doe.report.comparison import comparison_json, comparison_text
    from tripod_doe.report.comparison_page import write_comparison
    from tripod_doe.study.results import open_cube

    if options.reference_angle is not None and not math.isfinite(options.reference_angle):
        raise InputError(f"--reference-angle {options.reference_angle}: must be a finite angle in degrees")
    point = model_point(open_cube(options.cube), options.select, options.nearest)
    columns = dict(map(parse_column, options.column))
    measurement = read_measurement(options.measurement, options.pulses_per_revolution, columns)
    comparison = compare(measurement, point, options.reference_angle, parse_speeds(options.speeds))
    print(comparison_json(comparison) if options.format == "json" else comparison_text(comparison))
    if options.output is not None:
        print(f"report  {write_comparison(comparison, options.output)}", file=sys.stderr)
    return DONE


def _schema(options: argparse.Namespace) -> int:
    if options.kind == "workflow":
        from tripod_doe.workflow.file import workflow_schema

        if options.brief:
            raise InputError("--brief: only of study files")
        print(json.dumps(workflow_schema(), indent=1))
        return DONE
    from tripod_doe.study.schema import brief_schema, study_schema

    print(brief_schema(options.scene) if options.brief else json.dumps(study_schema(options.scene), indent=1))
    return DONE


def _init(options: argparse.Namespace) -> int:
    from tripod_doe.study.template import write_template

    path = write_template(options.name, options.kind)
    print(path)
    print(f"next: tripod-doe plan {path}", file=sys.stderr)
    return DONE


def _completion(options: argparse.Namespace) -> int:
    from tripod_doe.completion import completion_script

    print(completion_script(_parser(["simulate"]), options.shell))  # with the flags of its parameters
    return DONE


_COMMANDS = {
    "run": _Command("run a study, or the points of it that are missing", _add_run, _run),
    "plan": _Command("estimate points, time and size of a study; writes nothing", _add_plan, _plan),
    "query": _Command("select values of a cube and print them", _add_query, _query),
    "simulate": _Command("simulate one point", _add_simulate, _simulate),
    "report": _Command("write the report of a result directory again", _add_report, _report),
    "workflow": _Command("run a chain of studies, analyses, figures and reports", _add_workflow, _workflow),
    "compare": _Command("compare a measurement with one point, or with the points over speed", _add_compare, _compare),
    "schema": _Command("print the schema of study or workflow files", _add_schema, _schema),
    "init": _Command("write a study file to start from", _add_init, _init),
    "completion": _Command("print a script that completes commands in a shell", _add_completion, _completion),
}
"""All commands by the word that calls them, in the order of the help."""


if __name__ == "__main__":
    sys.exit(main())
