"""Search for the best joint within limits."""

import argparse
import logging
import sys
from collections.abc import Sequence
from pathlib import Path

from tripod_doe.cli.parser import DONE, SOME_FAILED, Command, Parser, add_execution, add_out, add_untrusted


def _add_arguments(parser: Parser, arguments: Sequence[str]) -> None:
    parser.add_argument("file", metavar="OPTIMISE.toml", type=Path, help="optimisation file")
    add_out(parser)
    add_execution(parser, "worker processes")
    parser.add_argument("--scheduler", metavar="ADDRESS", help="address of a running Dask scheduler to use")
    add_untrusted(parser)


def _run(options: argparse.Namespace) -> int:
    from tripod_doe.analyses.optimisation.stored_candidates import front_lines
    from tripod_doe.study.failure_summary import failure_lines
    from tripod_doe.workflow.optimise import optimise

    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    summary = optimise(
        options.file,
        options.out,
        workers=options.workers,
        scheduler=options.scheduler,
        retry_failed=options.retry_failed,
        oversubscribe=options.oversubscribe,
        untrusted=options.untrusted,
        take_over=options.take_over,
    )
    print("\n".join([*front_lines(summary.front), *filter(None, [summary.found])]))
    for line in [*summary.lines, *failure_lines(summary.failures)]:
        print(line, file=sys.stderr)
    print(f"{summary.computed:,} points computed, {summary.reused:,} reused", file=sys.stderr)
    print(f"front   {summary.directory / 'front.nc'}", file=sys.stderr)
    print(f"report  {summary.directory / 'report' / 'index.html'}", file=sys.stderr)
    return DONE if summary.good else SOME_FAILED


COMMAND = Command("search for the best joint within limits", _add_arguments, _run)
