"""A run in a notebook: its progress while it computes, and its summary as HTML."""

import html
import sys
import time
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, Self

from tripod_doe.quantities import count_of

_PAUSE = 0.2  # seconds between two pictures of the progress


class LiveProgress:
    """The progress of a run below the cell of a notebook that started it.

    Args:
        display: A handle of IPython's display, which replaces what it shows.
        page: IPython's HTML.
        total: Number of points.
    """

    def __init__(self, display: Any, page: Any, total: int) -> None:
        self._handle, self._page, self._total = display, page, total
        self._shown = 0.0

    @classmethod
    def of_this_cell(cls, total: int) -> Self | None:
        """The progress below the running cell; None outside of a notebook."""
        ipython = sys.modules.get("IPython")  # a notebook has imported it
        shell = ipython.get_ipython() if ipython else None
        if not hasattr(shell, "kernel"):
            return None
        from IPython.display import HTML, display

        return cls(display(HTML(_bar(0, total, "")), display_id=True), HTML, total)

    def show(self, done: int, left: str) -> None:
        """Show how far the run is, five times a second at most, and its end."""
        now = time.monotonic()
        if now - self._shown >= _PAUSE or done >= self._total:
            self._shown = now
            self._handle.update(self._page(_bar(done, self._total, left)))


def _bar(done: int, total: int, left: str) -> str:
    words = html.escape(f"{done:,} of {count_of(total, 'point')}{left}")
    return f'<progress value="{done}" max="{total}" aria-label="points"></progress> {words}'


def summary_html(counts: str, sentences: Sequence[str], problems: Iterable[str], directory: Path) -> str:
    """The summary of a run: counts of points, findings, failures, and the place of its report."""
    report = directory / "report" / "index.html"
    lines = [f"<li>{html.escape(text)}</li>" for text in sentences]
    wrong = [f"<li><strong>{html.escape(text)}</strong></li>" for text in problems]
    return (
        f"<p>{html.escape(counts)}</p><ul>{''.join(wrong + lines)}</ul>"
        f'<p><a href="{html.escape(report.as_posix())}">Report</a>, results in '
        f"<code>{html.escape(str(directory))}</code></p>"
    )
