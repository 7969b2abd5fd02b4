"""The parser of commands, arguments that several commands share, and exit codes."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from tripod_doe.errors import InputError, closest, near_match
from tripod_doe.typed_numbers import typed_number

if TYPE_CHECKING:
    from tripod_doe.model_interface import Parameter

DONE, INTERNAL, WRONG_INPUT, SOME_FAILED = 0, 1, 2, 3


class Parser(argparse.ArgumentParser):
    """An argument parser that accepts - and _ alike and names the nearest known flag."""

    def __init__(self, **options: Any) -> None:
        super().__init__(**(options | {"allow_abbrev": False}))

    def refuse(self, word: str) -> NoReturn:
        """Refuse a word that the command does not take."""
        flag = word.partition("=")[0]
        flags = [flag for action in self._actions for flag in action.option_strings]
        unknown = f"unknown flag {flag}{closest(flag, flags)}"
        self.error(unknown if flag.startswith("-") else f"unexpected argument {word!r}")

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        """Refuse a word that is not a choice of an argument, and name the nearest choice (argparse only lists them)."""
        if action.choices is not None and value not in action.choices:
            raise argparse.ArgumentError(action, f"invalid choice: {value!r}{near_match(str(value), action.choices)}")

    def _print_message(self, message: str, file: Any = None) -> None:
        """Write help to standard output; argparse would ignore an error in writing."""
        (file or sys.stderr).write(message)

    def error(self, message: str) -> NoReturn:
        """Print the message and where to find help, and exit with code 2."""
        print(f"{self.prog}: {message}", file=sys.stderr)
        print(f"try: {self.prog} --help", file=sys.stderr)
        raise SystemExit(WRONG_INPUT)


@dataclass(frozen=True)
class Command:
    """One command: its line of help, the function that adds its arguments, and the function that runs it.

    The run function takes the parsed options and returns the exit code; it imports what it needs when it is called.
    """

    help: str
    add_arguments: Callable[[Parser, Sequence[str]], None]
    run: Callable[[argparse.Namespace], int]


def whole_number(text: str) -> int:
    """The whole number that the value of a flag is."""
    try:
        typed_number(text)  # with ASCII digits
        return int(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{text!r}: expected a whole number") from error


def any_number(text: str) -> float:
    """The number that the value of a flag is."""
    try:
        return typed_number(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{text!r}: expected a number") from error


def parameter_value(parameter: Parameter, text: str, flag: str) -> Any:
    """The value of a parameter from the text after its flag."""
    if parameter.kind == "choice":
        return text
    try:
        return typed_number(text)
    except ValueError as error:
        raise InputError(f"--{flag} {text!r}: expected a number ({parameter.range_text})") from error


def add_study(parser: Parser) -> None:
    """Add the argument that names a study file."""
    parser.add_argument("study", metavar="STUDY.toml", type=Path, help="study file")


def add_untrusted(parser: Parser) -> None:
    """Add the flag for a file from a stranger."""
    parser.add_argument(
        "--untrusted",
        action="store_true",
        help="for a file that you do not trust: refuse functions, and files outside of its folder",
    )


def add_cube(parser: Parser) -> None:
    """Add the argument that names a cube."""
    parser.add_argument("cube", metavar="DIR|CUBE.nc", type=Path, help="result directory or cube")


def add_out(parser: Parser) -> None:
    """Add the flag that names a result directory."""
    parser.add_argument("--out", metavar="DIR", type=Path, required=True, help="result directory")


def add_format(parser: Parser, *others: str) -> None:
    """Add the flag that chooses the form of an answer: table, JSON and `others`."""
    parser.add_argument("--format", choices=("table", "json", *others), default="table", help="output format")


def add_selection(parser: Parser, text: str) -> None:
    """Add the flags that select cells of a cube; `text` says what a selection may be."""
    parser.add_argument("--select", metavar="NAME=VALUE", action="append", default=[], help=f"{text}; may be repeated")
    parser.add_argument("--nearest", action="store_true", help="take the nearest value where none matches")


def add_execution(parser: Parser, workers: str) -> None:
    """Add the flags for where points run and which run again; `workers` describes the worker processes."""
    parser.add_argument(
        "--workers",
        metavar="N",
        type=whole_number,
        help=f"{workers}; 0: compute in this process (default: 0 for studies of a few seconds, else 2)",
    )
    parser.add_argument(
        "--oversubscribe", action="store_true", help="start all --workers even if this machine has fewer processors"
    )
    parser.add_argument("--retry-failed", action="store_true", help="run failed points again")
    add_take_over(parser)
    add_notify(parser)


def add_take_over(parser: Parser) -> None:
    """Add the flag for the directory of a process that died on another machine."""
    parser.add_argument(
        "--take-over", action="store_true", help="take over a directory from a process that died while holding it"
    )


def add_notify(parser: Parser) -> None:
    """Add the flag that names whom to notify at the end of a run."""
    parser.add_argument(
        "--notify",
        metavar="COMMAND|URL|@FILE",
        help="at the end of a run, start this command with a summary as JSON on its standard input, or send them to "
        "this address; @FILE reads command or address from a file, so that the list of processes does not show it",
    )
