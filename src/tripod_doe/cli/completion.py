"""Completion of the command line in a shell: commands, flags, choices and files."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

import shtab


def completion_script(parser: argparse.ArgumentParser, shell: str) -> str:
    """The script that makes a shell complete the words of a parser; `shell` is bash or zsh."""
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
