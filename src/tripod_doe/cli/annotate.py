"""The command annotate."""

import argparse
import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from tripod_doe.cli.parser import DONE, Command, Parser, add_format


def _add_arguments(parser: Parser, arguments: Sequence[str]) -> None:
    parser.add_argument("directory", metavar="DIR", type=Path, help="result directory")
    parser.add_argument("--name", metavar="TEXT", help="name to show; customer/joint-7 lies in the folder customer")
    parser.add_argument("--owner", metavar="TEXT", help="person responsible for it")
    parser.add_argument("--tags", metavar="A,B", help="replace all tags; an empty text removes them")
    parser.add_argument("--note", metavar="TEXT", help="note in Markdown")
    add_format(parser)


def _run(options: argparse.Namespace) -> int:
    from tripod_doe.study.result_directory.annotation import annotated, read_annotation, write_annotation

    changes = {key: getattr(options, key) for key in ("name", "owner", "note") if getattr(options, key) is not None}
    if options.tags is not None:
        changes["tags"] = [tag for tag in options.tags.split(",") if tag.strip()]
    annotation = read_annotation(options.directory)
    if changes:
        annotation = annotated(annotation, changes)
        write_annotation(options.directory, annotation)
    values = asdict(annotation)
    if options.format == "json":
        print(json.dumps(values))
        return DONE
    shown = {key: ", ".join(value) if key == "tags" else value for key, value in values.items()}
    print(
        "\n".join(f"{key}  {value}" for key, value in shown.items() if value) or "it has no name, owner, tags or note"
    )
    return DONE


COMMAND = Command("set name, owner, tags and note of a result directory, or print them", _add_arguments, _run)
