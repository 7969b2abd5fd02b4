"""Fit unknown parameters to measured records."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from tripod_doe.cli.parser import DONE, SOME_FAILED, Command, Parser, add_execution, add_out, add_untrusted


def _add_arguments(parser: Parser, arguments: Sequence[str]) -> None:
    parser.add_argument("file", metavar="FIT.toml", type=Path, help="fit file")
    add_out(parser)
    add_execution(parser, "worker processes")
    add_untrusted(parser)


def _run(options: argparse.Namespace) -> int:
    from tripod_doe.analyses.fit.sentences import fit_lines
    from tripod_doe.study.failure_summary import failure_lines
    from tripod_doe.workflow.fit import fit

    summary = fit(
        options.file,
        options.out,
        workers=options.workers,
        retry_failed=options.retry_failed,
        oversubscribe=options.oversubscribe,
        untrusted=options.untrusted,
        take_over=options.take_over,
    )
    print("\n".join([*fit_lines(summary.result), *filter(None, [summary.found])]))
    for line in failure_lines(summary.failures):
        print(line, file=sys.stderr)
    print(f"{summary.computed:,} points computed, {summary.reused:,} reused", file=sys.stderr)
    print(f"report  {summary.directory / 'report' / 'index.html'}", file=sys.stderr)
    return DONE if summary.good else SOME_FAILED


COMMAND = Command("fit unknown parameters to measured records", _add_arguments, _run)
