"""The hash of all that determines the result of a step: a step whose hash is the same is not made again.

What enters it is chosen where the step is read, in `workflow`.
"""

import hashlib
from pathlib import Path

import tripod_doe


class StepHash:
    """A hash over texts and bytes, each preceded by its length."""

    def __init__(self, *texts: str) -> None:
        self._sha = hashlib.sha256()
        self.add(*texts)

    def add(self, *texts: str) -> None:
        """Add texts, one after the other."""
        for text in texts:
            self.add_bytes(text.encode())

    def add_bytes(self, data: bytes) -> None:
        """Add the contents of a file, or other bytes, with their length before them."""
        self._sha.update(len(data).to_bytes(8, "little"))
        self._sha.update(data)

    def add_code(self, *folders: str) -> None:
        """Add the sources of parts of this package, so that a changed analysis or page is made again."""
        for folder in folders:
            root = Path(tripod_doe.__file__).parent / folder
            sources = sorted(path for path in root.rglob("*") if path.suffix in (".py", ".html", ".css", ".js"))
            if not sources:
                raise FileNotFoundError(f"{root}: no sources")
            for path in sources:
                self.add_bytes(path.read_bytes())

    def text(self) -> str:
        """The hash of all that was added, 16 hex digits."""
        return str(self._sha.hexdigest()[:16])
