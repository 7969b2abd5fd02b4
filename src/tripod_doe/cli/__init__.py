"""The command line: `main` runs it; the commands stand in `studies`, `answers` and `starting`.

The imports of a command stand in its function: each loads only what it needs.
"""

from tripod_doe.cli.main import main

__all__ = ["main"]
