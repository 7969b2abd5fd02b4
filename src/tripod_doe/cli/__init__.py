"""The command line: one module per command, the parser that they share, and `main`, which runs them.

A module imports what its command needs when it is called, so that each command loads only that.
"""

from tripod_doe.cli.main import main

__all__ = ["main"]
