"""The command line: run, plan, query, simulate, report, workflow, compare, schema.

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
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from tripod_doe.errors import InputError, TripodDoeError, near_match
from tripod_doe.interrupts import INTERRUPTED, check_interrupt, leave_interrupted, take_interrupts
from tripod_doe.simulator import Outcome, Parameter, Simulator
from tripod_doe.study.scenes import SCENES, load_simulator

__all__ = ["main"]

DONE, INTERNAL, WRONG_INPUT, SOME_FAILED = 0, 1, 2, 3


class _Parser(argparse.ArgumentParser):
    """An argument parser that accepts - and _ alike and names the nearest known flag."""

    def __init__(self, **options: Any) -> None:
        super().__init__(**(options | {"allow_abbrev": False}))

    def refuse(self, word: str) -> NoReturn:
        """Say that a word of the command line is not known here."""
        flag = word.partition("=")[0]
        flags = [flag for action in self._actions for flag in action.option_strings]
        self.error(f"unknown flag {flag}{near_match(flag, flags)}" if flag.startswith("-") else f"{word!r} is too much")

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        """Refuse a word that is none of an argument's choices, with the nearest one (argparse only lists them)."""
        if action.choices is not None and value not in action.choices:
            raise argparse.ArgumentError(action, f"invalid choice: {value!r}{near_match(str(value), action.choices)}")

    def error(self, message: str) -> NoReturn:
        """Print the message and where to look, and leave with exit code 2."""
        print(f"{self.prog}: {message}", file=sys.stderr)
        print(f"try: {self.prog} --help", file=sys.stderr)
        raise SystemExit(WRONG_INPUT)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line, that of this process unless words are given; returns the exit code."""
    if arguments is not None:
        return _run_command([_dashes(word) for word in arguments])
    take_interrupts()
    code = _run_command([_dashes(word) for word in sys.argv[1:]])
    leave_interrupted()
    return code


def _run_command(arguments: Sequence[str]) -> int:
    """Run a command, and tell in words and in the exit code why it ended."""
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
        print("tripod-doe: interrupted; finished points are kept, run again to go on", file=sys.stderr)
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


def _parser(arguments: Sequence[str]) -> _Parser:
    parser = _Parser(prog="tripod-doe", description="Parameter studies for the thrust force of tripod joints.")
    commands = parser.add_subparsers(required=True, metavar="COMMAND", parser_class=_Parser)

    run = commands.add_parser("run", help="run a study, or what is missing of it")
    run.add_argument("study", metavar="STUDY.toml", type=Path, help="study file")
    run.add_argument("--out", metavar="DIR", type=Path, required=True, help="result directory")
    run.add_argument("--workers", metavar="N", type=int, default=2, help="worker processes (default 2)")
    run.add_argument("--scheduler", metavar="ADDRESS", help="existing Dask scheduler to use instead of a local cluster")
    run.add_argument("--retry-failed", action="store_true", help="run failed points again")
    run.add_argument("--fail-fast", action="store_true", help="stop at the first point that fails unexpectedly")
    run.set_defaults(command=_run, parser=run)

    plan = commands.add_parser("plan", help="say what a study will cost; nothing is run or written")
    plan.add_argument("study", metavar="STUDY.toml", type=Path, help="study file")
    plan.add_argument("--no-timing", action="store_true", help="count only, time no points")
    plan.add_argument("--out", metavar="DIR", type=Path,
                      help='of a study with model = "auto": result directory whose choice to show')  # fmt: skip
    plan.add_argument("--workers", metavar="N", type=int, default=2, help="worker processes to plan for (default 2)")
    plan.set_defaults(command=_plan, parser=plan)

    query = commands.add_parser("query", help="ask a cube")
    query.add_argument("cube", metavar="DIR|CUBE.nc", type=Path, help="result directory or cube")
    query.add_argument("--variable", metavar="NAME", required=True, help="variable to show")
    query.add_argument("--select", metavar="NAME=VALUE", action="append", default=[],
                       help="a value, a list a,b,c or a range a:b of a coordinate; may be repeated")  # fmt: skip
    query.add_argument("--nearest", action="store_true", help="take the nearest value where none matches")
    query.add_argument("--where", metavar="EXPR", help="condition on coordinates, variables and outcome")
    query.add_argument(
        "--format", choices=("table", "csv", "json", "netcdf"), default="table", help="form of the answer"
    )
    query.add_argument("--output", metavar="FILE", type=Path, help="write the answer to a file")
    query.set_defaults(command=_query, parser=query)

    simulate = commands.add_parser("simulate", help="simulate one point")
    simulate.add_argument("--scene", default="joint", metavar="S", help=f"scene: {', '.join(SCENES)} (default joint)")
    simulate.add_argument("--format", choices=("table", "json"), default="table", help="form of the answer")
    if "simulate" in arguments[:1]:
        _add_parameters(simulate, load_simulator(_scene_named_in(arguments)))
    simulate.set_defaults(command=_simulate, parser=simulate)

    report = commands.add_parser("report", help="make the report of a result directory again")
    report.add_argument("directory", metavar="DIR", type=Path, help="result directory")
    report.set_defaults(command=_report, parser=report)

    workflow = commands.add_parser("workflow", help="run a chain of studies, analyses, figures and reports")
    workflow.add_argument("file", metavar="FILE.toml", type=Path, help="workflow file")
    workflow.add_argument("--out", metavar="DIR", type=Path, required=True, help="result directory")
    workflow.add_argument("--only", metavar="STEP", help="run this step and what it needs, and no other")
    workflow.add_argument("--quick", action="store_true", help="apply the overrides of [quick]: smaller studies")
    workflow.add_argument("--workers", metavar="N", type=int, default=2,
                          help="worker processes that all studies share (default 2)")  # fmt: skip
    workflow.add_argument("--retry-failed", action="store_true", help="run failed points again")
    workflow.set_defaults(command=_workflow, parser=workflow)

    compare = commands.add_parser("compare", help="lay a measured thrust force over a point of a cube")
    compare.add_argument("cube", metavar="DIR|CUBE.nc", type=Path, help="result directory or cube")
    compare.add_argument("measurement", metavar="MEASUREMENT.csv", type=Path,
                         help="columns thrust_n and rotation_deg, or thrust_n, time_s and tacho")  # fmt: skip
    compare.add_argument("--select", metavar="NAME=VALUE", action="append", default=[],
                         help="the value of a factor, so that one point is left; may be repeated")  # fmt: skip
    compare.add_argument("--nearest", action="store_true", help="take the nearest value where none matches")
    compare.add_argument("--pulses-per-revolution", metavar="N", type=int, default=1,
                         help="rising edges of tacho a revolution (default 1)")  # fmt: skip
    compare.add_argument("--reference-angle", metavar="DEG", type=float,
                         help="rotation angle of the housing at the first rising edge, or at rotation_deg = 0; "
                         "the third orders are put in phase unless given")  # fmt: skip
    compare.add_argument(
        "--speeds", metavar="LOW:HIGH", help="compare only revolutions with a speed in this range, rpm"
    )
    compare.add_argument("--format", choices=("table", "json"), default="table", help="form of the answer")
    compare.add_argument("--output", metavar="FILE|DIR", type=Path,
                         help="write a report page: FILE.html, or DIR/index.html with DIR/comparison.nc")  # fmt: skip
    compare.set_defaults(command=_compare, parser=compare)

    schema = commands.add_parser("schema", help="print the JSON schema of study or workflow files")
    schema.add_argument("kind", choices=("study", "workflow"), help="what to describe")
    schema.add_argument("--scene", default="joint", metavar="S", help="scene whose parameters are listed")
    schema.set_defaults(command=_schema, parser=schema)
    return parser


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
    from tripod_doe.workflow.run import run  # Dask and plotting are slow to import

    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    summary = run(
        options.study, options.out, options.workers, options.scheduler, options.retry_failed, options.fail_fast
    )
    for sentence in summary.findings:
        print(sentence, file=sys.stderr)
    for name, reason in summary.analyses.items():
        if reason:
            print(f"analysis {name} was not made: {reason}", file=sys.stderr)
    for label, count in summary.failed.items():
        print(f"{count:,} points ended as {label}; see outcome_detail, or --retry-failed", file=sys.stderr)
    rate = (
        f" in {summary.seconds:.1f} s ({summary.computed / summary.seconds:,.0f} a second)" if summary.computed else ""
    )
    print(f"{summary.computed:,} points computed{rate}, {summary.reused:,} were there", file=sys.stderr)
    print(f"cube    {summary.directory / 'cube.nc'}", file=sys.stderr)
    print(f"report  {summary.directory / 'report' / 'index.html'}", file=sys.stderr)
    return DONE if summary.good else SOME_FAILED


def _plan(options: argparse.Namespace) -> int:
    from tripod_doe.analysis.registry import check_analyses
    from tripod_doe.study.definition import load_study
    from tripod_doe.study.plan import plan

    study = load_study(options.study)
    check_analyses(study)
    print(plan(study, timing=not options.no_timing).describe(max(options.workers, 1)))
    if study.accuracy:
        from tripod_doe.workflow.choice import describe_choice

        print(describe_choice(study, options.out))
    return DONE


def _query(options: argparse.Namespace) -> int:
    from tripod_doe.study.netcdf import write_dataset
    from tripod_doe.study.query import frame_text, narrowed, query

    answer = query(options.cube, options.variable, options.select, options.nearest, options.where)
    if options.format == "netcdf":
        if options.output is None:
            raise InputError("--format netcdf needs --output FILE")
        write_dataset(narrowed(answer), options.output)
        return DONE
    text = frame_text(answer, options.format)
    if options.output is None:
        print(text)
        return DONE
    try:
        options.output.write_text(text + "\n", encoding="utf-8")
    except OSError as error:
        raise InputError(f"--output {options.output}: cannot write: {error.strerror}") from error
    return DONE


def _simulate(options: argparse.Namespace) -> int:
    from tripod_doe.study.simulate import simulate

    simulator = load_simulator(options.scene)
    given = {
        name: _parameter_value(parameter, getattr(options, name))
        for name, parameter in simulator.parameters.items()
        if getattr(options, name) is not None
    }
    result = simulate(options.scene, **given)
    outcome = Outcome(int(result["outcome"]))
    names = [str(name) for name in result.data_vars if not str(name).startswith("outcome")]
    outputs = {name: _plain(result[name].values) for name in names}
    usual = [name for name, output in simulator.outputs.items() if not output.on_request]
    answer = {
        "scene": options.scene,
        "parameters": result.attrs["parameters"],
        **(dict.fromkeys(usual) | outputs),  # null where the point did not get that far
        "coordinates": {str(name): _plain(values.values) for name, values in result.coords.items()},
        "outcome": outcome.label,
        "outcome_detail": str(result["outcome_detail"].values),
        "cost": result.attrs["cost"],
    }
    if options.format == "json":
        print(json.dumps(answer, allow_nan=False))
    else:
        print(_table(answer, outputs, simulator))
    return DONE if outcome is Outcome.FINISHED else SOME_FAILED


def _plain(values: Any) -> Any:
    """Numbers and lists for JSON, NaN as None."""
    if isinstance(values, np.ndarray) and values.ndim:
        return [_plain(item) for item in values]
    value = values.item() if isinstance(values, np.ndarray | np.generic) else values
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _table(answer: dict[str, Any], outputs: dict[str, Any], simulator: Simulator) -> str:
    """One line an output, for people; waveforms only by their range."""
    lines = [f"outcome  {answer['outcome']} {answer['outcome_detail']}".rstrip()]
    for name, values in outputs.items():
        unit = simulator.outputs[name].unit_text
        array = np.asarray(values, float)
        if "rotation_deg" in simulator.outputs[name].dims:
            shown = f"{np.nanmin(array):.5g} .. {np.nanmax(array):.5g}"
        else:
            shown = np.array2string(array, precision=5, suppress_small=True, max_line_width=110, separator=" ")
        lines.append(f"{name} [{unit or '-'}]\n    " + shown.replace("\n", "\n    "))
    lines.append("cost  " + ", ".join(f"{key} {value:.4g}" for key, value in answer["cost"].items()))
    return "\n".join(lines)


def _report(options: argparse.Namespace) -> int:
    from tripod_doe.report.page import write_report

    print(write_report(options.directory))
    return DONE


def _workflow(options: argparse.Namespace) -> int:
    from tripod_doe.workflow.chain import run_workflow

    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    summary = run_workflow(
        options.file, options.out, options.only, options.quick, options.workers, options.retry_failed
    )  # fmt: skip
    counts = Counter(step.state for step in summary.steps)
    print(", ".join(f"{count} {state}" for state, count in counts.items()), file=sys.stderr)
    print(f"report  {summary.page}", file=sys.stderr)
    return DONE if summary.good else SOME_FAILED


def _compare(options: argparse.Namespace) -> int:
    from tripod_doe.analysis.comparison import compare, model_point
    from tripod_doe.analysis.measurement import read_measurement
    from tripod_doe.report.comparison import comparison_json, comparison_text, write_comparison
    from tripod_doe.study.netcdf import open_cube

    if options.reference_angle is not None and not math.isfinite(options.reference_angle):
        raise InputError(f"--reference-angle {options.reference_angle}: must be a finite angle in degrees")
    point = model_point(open_cube(options.cube), options.select, options.nearest)
    measurement = read_measurement(options.measurement, options.pulses_per_revolution)
    comparison = compare(measurement, point, options.reference_angle, _speed_range(options.speeds))
    print(comparison_json(comparison) if options.format == "json" else comparison_text(comparison))
    if options.output is not None:
        print(f"report  {write_comparison(comparison, options.output)}", file=sys.stderr)
    return DONE


def _speed_range(text: str | None) -> tuple[float, float] | None:
    if text is None:
        return None
    try:
        low, high = (float(end) for end in text.split(":"))
    except ValueError as error:
        raise InputError(f"--speeds {text!r}: write two speeds in rpm, LOW:HIGH") from error
    return low, high


def _schema(options: argparse.Namespace) -> int:
    if options.kind == "workflow":
        from tripod_doe.workflow.file import workflow_schema

        print(json.dumps(workflow_schema(), indent=1))
        return DONE
    from tripod_doe.study.schema import study_schema

    print(json.dumps(study_schema(options.scene), indent=1))
    return DONE


if __name__ == "__main__":
    sys.exit(main())
