"""Run a study, or go on with one that was interrupted."""

import argparse
import logging
import re
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from tripod_doe.cli.parser import DONE, SOME_FAILED, Command, Parser, add_execution, add_out, add_study, add_untrusted
from tripod_doe.number_text import count_of, duration, pace


def _seconds(text: str) -> float:
    """A time such as ``90``, ``30s``, ``10min``, ``10m`` or ``2h``."""
    match = re.fullmatch(r"(\d+(?:\.\d+)?)\s*(s|m|min|h|d)?", text)
    if match is None:
        raise argparse.ArgumentTypeError(f"{text!r}: write a time such as 90, 30s, 10min or 2h")
    return float(match[1]) * {None: 1, "s": 1, "m": 60, "min": 60, "h": 3600, "d": 86400}[match[2]]


def _add_arguments(parser: Parser, arguments: Sequence[str]) -> None:
    add_study(parser)
    add_out(parser)
    add_execution(parser, "worker processes")
    parser.add_argument("--scheduler", metavar="ADDRESS", help="address of a running Dask scheduler to use")
    parser.add_argument(
        "--scheduler-file", metavar="FILE", type=Path, help="scheduler file of Dask, instead of the address"
    )
    parser.add_argument(
        "--wait",
        metavar="TIME",
        type=_seconds,
        help="how long to wait for a scheduler: 30s, 2h (default 1min for a lost one)",
    )
    for name, what in (
        ("--tls-ca-file", "certificate of the authority that signed the scheduler's, for TLS"),
        ("--tls-cert", "certificate of this client, for TLS"),
        ("--tls-key", "key of that certificate, unless it is in the same file"),
    ):
        parser.add_argument(name, metavar="PEM", type=Path, help=what)
    parser.add_argument("--fail-fast", action="store_true", help="stop at the first point that fails unexpectedly")
    add_untrusted(parser)
    parser.add_argument("--export", choices=("zarr",), help="also write the cube in this format, as DIR/cube.zarr")


def _run(options: argparse.Namespace) -> int:
    from tripod_doe.study.definition.study_file import load_study
    from tripod_doe.study.definition.study_folder import StudyFolder
    from tripod_doe.study.failure_summary import failure_lines
    from tripod_doe.study.result_directory.stored_study import is_stored
    from tripod_doe.workflow.run_study import run  # Dask and plotting are slow to import

    if options.export:
        from tripod_doe.study.result_directory.zarr_store import export_zarr, refuse_without_zarr

        refuse_without_zarr()
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    folder = StudyFolder.of(options.study, options.untrusted)
    summary = run(
        load_study(options.study, replace(folder, has_results=is_stored(options.out, options.study))),
        options.out,
        workers=options.workers,
        scheduler=options.scheduler,
        retry_failed=options.retry_failed,
        fail_fast=options.fail_fast,
        oversubscribe=options.oversubscribe,
        scheduler_file=options.scheduler_file,
        wait=options.wait,
        take_over=options.take_over,
        tls_ca_file=options.tls_ca_file,
        tls_cert=options.tls_cert,
        tls_key=options.tls_key,
        refuse_impossible=True,
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


COMMAND = Command("run a study, or the points of it that are missing", _add_arguments, _run)
