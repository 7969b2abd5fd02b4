"""Commands that compute: run, plan, report, workflow."""

from __future__ import annotations

import argparse
import logging
import re
import sys
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from tripod_doe.cli.parser import (
    DONE,
    SOME_FAILED,
    Command,
    Parser,
    add_execution,
    add_out,
    add_study,
)
from tripod_doe.errors import InputError, option
from tripod_doe.quantities import count_of, duration, pace

_SILENT_POINTS = 200_000
"""Points up to which a plan needs no word while it is made."""
_CHECK_SECONDS = 25e-6
"""Time that a plan takes per point of the joint (Intel Xeon, idle)."""


def _seconds(text: str) -> float:
    """A time such as ``90``, ``30s``, ``10min`` or ``2h``."""
    match = re.fullmatch(r"(\d+(?:\.\d+)?)\s*(s|min|h|d)?", text)
    if match is None:
        raise argparse.ArgumentTypeError(f"{text!r}: write a time such as 90, 30s, 10min or 2h")
    return float(match[1]) * {None: 1, "s": 1, "min": 60, "h": 3600, "d": 86400}[match[2]]


def _add_run(parser: Parser, arguments: Sequence[str]) -> None:
    add_study(parser)
    add_out(parser)
    add_execution(parser, "worker processes")
    parser.add_argument("--scheduler", metavar="ADDRESS", help="address of a running Dask scheduler to use")
    parser.add_argument(
        "--scheduler-file", metavar="FILE", type=Path, help="file of that scheduler, in place of its address"
    )
    parser.add_argument(
        "--wait",
        metavar="TIME",
        type=_seconds,
        help="how long to wait for a scheduler: 30s, 2h (default 1min for a lost one)",
    )
    parser.add_argument(
        "--take-over", action="store_true", help="take the place of a dead process that still holds the directory"
    )
    parser.add_argument("--fail-fast", action="store_true", help="stop at the first point that fails unexpectedly")
    parser.add_argument("--export", choices=("zarr",), help="write the cube in this form, too, as DIR/cube.zarr")


def _add_plan(parser: Parser, arguments: Sequence[str]) -> None:
    parser.add_argument("file", metavar="FILE.toml", type=Path, help="study file or workflow file")
    parser.add_argument("--no-timing", action="store_true", help="count points and bytes only, without timing")
    parser.add_argument(
        "--out",
        metavar="DIR",
        type=Path,
        help='result directory with models that a pilot chose (model = "auto"), or with a split, to show them',
    )
    parser.add_argument("--quick", action="store_true", help="for a workflow: plan the smaller studies of [quick]")
    parser.add_argument("--workers", metavar="N", type=int, default=2, help="worker processes to plan for (default 2)")


def _add_report(parser: Parser, arguments: Sequence[str]) -> None:
    parser.add_argument("directory", metavar="DIR", type=Path, help="result directory")


def _add_workflow(parser: Parser, arguments: Sequence[str]) -> None:
    parser.add_argument("file", metavar="FILE.toml", type=Path, help="workflow file")
    add_out(parser)
    parser.add_argument("--only", metavar="STEP", help="run only this step and the steps that it needs")
    parser.add_argument("--quick", action="store_true", help="run the smaller studies of [quick]")
    add_execution(parser, "worker processes that all studies share")


def _run(options: argparse.Namespace) -> int:
    from tripod_doe.study.failures import failure_lines
    from tripod_doe.workflow.run import run  # Dask and plotting are slow to import

    if options.export:
        from tripod_doe.study.zarr_store import export_zarr, refuse_without_zarr

        refuse_without_zarr()
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    summary = run(
        options.study,
        options.out,
        options.workers,
        options.scheduler,
        options.retry_failed,
        options.fail_fast,
        oversubscribe=options.oversubscribe,
        scheduler_file=options.scheduler_file,
        wait=options.wait,
        take_over=options.take_over,
    )
    for sentence in [*summary.answers, *summary.findings, *summary.model_notes]:
        print(sentence, file=sys.stderr)
    for name, reason in summary.analyses.items():
        if reason:
            print(f"analysis {name} failed: {reason}", file=sys.stderr)
    for line in failure_lines(summary.failures, summary.retried):
        print(line, file=sys.stderr)
    seconds, count = summary.seconds, summary.computed
    rate = f" in {duration(seconds)} ({pace(count, seconds)})" if count else ""
    print(f"{count_of(count, 'point')} computed{rate}, {summary.reused:,} reused", file=sys.stderr)
    print(f"cube    {summary.directory / 'cube.nc'}", file=sys.stderr)
    if options.export:
        print(f"zarr    {export_zarr(summary.directory)}", file=sys.stderr)
    print(f"report  {summary.directory / 'report' / 'index.html'}", file=sys.stderr)
    return DONE if summary.good else SOME_FAILED


def _plan(options: argparse.Namespace) -> int:
    from tripod_doe.study.file import is_workflow

    return (_plan_workflow if is_workflow(options.file) else _plan_study)(options)


def _plan_study(options: argparse.Namespace) -> int:
    from tripod_doe.study.definition import load_study
    from tripod_doe.study.designs import point_count
    from tripod_doe.study.plan import plan

    if options.quick:
        raise InputError(f"{option('quick')}: {options.file} is a study; only workflows have a [quick]")
    study = load_study(options.file)
    if study.file.analysis:
        from tripod_doe.workflow.analyses import check_analyses

        check_analyses(study)
    if (count := point_count(study)) > _SILENT_POINTS:
        print(f"checking {count:,} points: about {duration(count * _CHECK_SECONDS)}", file=sys.stderr)
    print(plan(study, timing=not options.no_timing).describe(max(options.workers, 1)))
    if study.accuracy:
        from tripod_doe.analysis.model_choice.study_choice import describe_choice

        print(describe_choice(study, options.out))
    if study.file.design.kind == "multifidelity":
        from tripod_doe.analysis.multifidelity.study_split import describe_split

        for line in describe_split(study, options.out):
            print(line)
    return DONE


def _plan_workflow(options: argparse.Namespace) -> int:
    from tripod_doe.workflow.plan import plan_workflow

    if options.out:
        raise InputError(
            f"{option('out')}: {options.file} is a workflow, and only a study has models chosen by a pilot"
        )
    print(plan_workflow(options.file, options.quick, not options.no_timing).describe(max(options.workers, 1)))
    return DONE


def _report(options: argparse.Namespace) -> int:
    from tripod_doe.report.page import write_report

    print(write_report(options.directory))
    return DONE


def _workflow(options: argparse.Namespace) -> int:
    from tripod_doe.workflow.chain import run_workflow

    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    summary = run_workflow(
        options.file,
        options.out,
        options.only,
        options.quick,
        options.workers,
        options.retry_failed,
        oversubscribe=options.oversubscribe,
    )
    counts = Counter(step.state for step in summary.steps)
    print(", ".join(f"{count} {state}" for state, count in counts.items()), file=sys.stderr)
    print(f"report  {summary.page}", file=sys.stderr)
    return DONE if summary.good else SOME_FAILED


COMMANDS = {
    "run": Command("run a study, or the points of it that are missing", _add_run, _run),
    "plan": Command("estimate points, time and size of a study or a workflow; writes nothing", _add_plan, _plan),
    "report": Command("write the report of a result directory again", _add_report, _report),
    "workflow": Command("run a chain of studies, analyses, figures and reports", _add_workflow, _workflow),
}
