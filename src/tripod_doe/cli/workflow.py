"""Run a workflow, or one of its steps with the steps that it needs."""

import argparse
import logging
import sys
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from tripod_doe.cli.parser import DONE, SOME_FAILED, Command, Parser, add_execution, add_out, add_untrusted


def _add_arguments(parser: Parser, arguments: Sequence[str]) -> None:
    parser.add_argument("file", metavar="FILE.toml", type=Path, help="workflow file")
    add_out(parser)
    parser.add_argument("--only", metavar="STEP", help="run only this step and the steps that it needs")
    parser.add_argument("--quick", action="store_true", help="run the smaller studies of [quick]")
    add_execution(parser, "worker processes that all studies share")
    add_untrusted(parser)


def _run(options: argparse.Namespace) -> int:
    from tripod_doe.workflow.run_workflow import run_workflow

    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    summary = run_workflow(
        options.file,
        options.out,
        only=options.only,
        quick=options.quick,
        workers=options.workers,
        retry_failed=options.retry_failed,
        oversubscribe=options.oversubscribe,
        untrusted=options.untrusted,
        take_over=options.take_over,
    )
    counts = Counter(step.state for step in summary.steps)
    print(", ".join(f"{count} {state}" for state, count in counts.items()), file=sys.stderr)
    for page in summary.reports:
        print(f"report  {page}", file=sys.stderr)
    print(f"{'steps ' if summary.reports else 'report'}  {summary.page}", file=sys.stderr)
    return DONE if summary.good else SOME_FAILED


COMMAND = Command("run a chain of studies, analyses, figures and reports", _add_arguments, _run)
