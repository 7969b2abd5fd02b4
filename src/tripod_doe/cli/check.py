"""The command check."""

import argparse
import json
from collections.abc import Sequence
from pathlib import Path

from tripod_doe.cli.parser import DONE, SOME_FAILED, Command, Parser, add_format


def _add_arguments(parser: Parser, arguments: Sequence[str]) -> None:
    parser.add_argument("path", metavar="DIR|FILE", type=Path, help="result directory, or one file of it")
    add_format(parser)


def _run(options: argparse.Namespace) -> int:
    from tripod_doe.study.result_directory.check import check_files

    files = check_files(options.path)
    if options.format == "json":
        print(json.dumps([{"file": str(file.path), "damage": file.damage, "note": file.note} for file in files]))
    else:
        for file in files:
            lost = "missing" if file.is_missing else "damaged"
            state = lost if not file.is_whole else "intact " if file.is_checked else "skipped"
            print(": ".join(filter(None, [f"{state}  {file.path}", file.damage or file.note])))
    return DONE if all(file.is_whole for file in files) else SOME_FAILED


COMMAND = Command("verify the files of a result directory against their checksums", _add_arguments, _run)
