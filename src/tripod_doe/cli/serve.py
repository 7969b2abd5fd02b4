"""Serve runs, cubes and reports in a browser and over HTTP."""

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from tripod_doe.cli.parser import DONE, Command, Parser, add_notify, whole_number
from tripod_doe.errors import InputError


def _add_arguments(parser: Parser, arguments: Sequence[str]) -> None:
    parser.add_argument(
        "--folder",
        metavar="DIR",
        type=Path,
        default=Path("results"),
        help="folder of the runs and their result directories (default results)",
    )
    parser.add_argument(
        "--host",
        default="127.0.0.1",
        metavar="HOST",
        help="where to listen (default 127.0.0.1: seen from this machine only)",
    )
    parser.add_argument(
        "--port", type=whole_number, default=8811, metavar="PORT", help="port (default 8811; 0: any free one)"
    )
    parser.add_argument(
        "--workers", type=whole_number, metavar="N", help="worker processes of each run (default: as run)"
    )
    parser.add_argument("--demo", action="store_true", help="start with a small finished study in the list")
    parser.add_argument("--read-only", action="store_true", help="show results only: run and change nothing")
    parser.add_argument(
        "--token-file",
        metavar="FILE",
        type=Path,
        help="file with the token; made if it is not there (default: a new token at each start)",
    )
    parser.add_argument(
        "--read-token-file",
        metavar="FILE",
        type=Path,
        help="file with a second token for reading only; made if it is not there",
    )
    add_notify(parser)


def _run(options: argparse.Namespace) -> int:
    from tripod_doe.service.server import serve
    from tripod_doe.service.settings import Settings, read_token

    settings = Settings(options.folder, options.host, options.port, options.workers, options.read_only, options.demo)
    if options.token_file is not None:
        settings = replace(settings, token=read_token(options.token_file))
    if options.read_token_file is not None:
        settings = replace(settings, read_token=read_token(options.read_token_file))
    if settings.read_token == settings.token:
        raise InputError(
            f"--read-token-file {options.read_token_file}: this is the token of the owner; name another file"
        )
    if options.notify is not None:
        from tripod_doe.notification import Notifier

        settings = replace(settings, notifier=Notifier.of(options.notify))
    serve(settings)
    return DONE


COMMAND = Command("show and run studies in a browser and over HTTP", _add_arguments, _run)
