"""The summary of a run in a notebook."""

import html
from collections.abc import Iterable, Sequence
from pathlib import Path


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
