"""Print a script that completes the command line in a shell: commands, flags, choices and files."""

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path

from tripod_doe.cli.parser import DONE, Command, Parser


def _add_arguments(parser: Parser, arguments: Sequence[str]) -> None:
    parser.add_argument("shell", choices=("bash", "zsh"), help="shell that reads it")


def _run(options: argparse.Namespace) -> int:
    parser = options.build_parser(["simulate"])  # with the flags of its parameters
    print(completion_script(parser, options.shell))
    return DONE


def completion_script(parser: argparse.ArgumentParser, shell: str) -> str:
    """The script that makes a shell complete the words of a parser; `shell` is bash or zsh."""
    import shtab

    for action in _path_arguments(parser):
        action.complete = shtab.FILE  # type: ignore[attr-defined]
    return str(shtab.complete(parser, shell))


def _path_arguments(parser: argparse.ArgumentParser) -> Iterator[argparse.Action]:
    """Arguments of all commands that are files or directories."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for own in action.choices.values():
                yield from _path_arguments(own)
        elif action.type is Path:
            yield action


COMMAND = Command("print a script that completes commands in a shell", _add_arguments, _run)
