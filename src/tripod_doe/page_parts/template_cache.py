"""Compiled templates of pages, kept on disk."""

import contextlib

from jinja2 import FileSystemBytecodeCache
from jinja2.bccache import Bucket

from tripod_doe.mechanics.compilation.sources import cache_root


class _CompiledTemplates(FileSystemBytecodeCache):
    """Compiled templates on disk; if they cannot be stored, they are compiled again."""

    def dump_bytecode(self, bucket: Bucket) -> None:
        """Store a compiled template if there is room."""
        with contextlib.suppress(OSError):
            super().dump_bytecode(bucket)


def compiled_templates() -> FileSystemBytecodeCache | None:
    """Folder of compiled templates, beside the kernels: compiling them took a tenth of a small run."""
    folder = cache_root() / "templates"
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return None
    return _CompiledTemplates(str(folder))
