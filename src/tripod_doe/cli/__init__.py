"""The command line: one module per command, the shared parser, and `main`, which runs a command.

A module imports what its command needs only when the command is called, so that each command loads little.
"""

from tripod_doe.cli.main import main

__all__ = ["main"]
