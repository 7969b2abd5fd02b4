"""The page of a fit."""

from pathlib import Path

import xarray as xr

from tripod_doe.analyses.fit.charts import fit_charts
from tripod_doe.analyses.fit.sentences import (
    RECORD_HEADS,
    UNKNOWN_HEADS,
    candidate_heads,
    candidate_rows,
    find_in_fit,
    record_rows,
    unknown_rows,
)
from tripod_doe.files.checksum_list import refuse_changed, write_listed
from tripod_doe.page_parts.answer import answer_first
from tripod_doe.page_parts.templates import render


def write_fit_page(directory: Path, fit: xr.Dataset) -> Path:
    """Write the page of a fit; returns its path, ``directory/report/index.html``.

    Raises:
        CubeError: If base.toml is damaged.
        StorageError: If it cannot be written; an older one stays.
    """
    sentences, more = answer_first(find_in_fit(fit))
    base = directory / "base.toml"
    refuse_changed(base)
    has_next = "next" in fit
    page = render(
        "fit.html",
        attrs=fit.attrs,
        records=fit.sizes["record"],
        sentences=sentences,
        more=more,
        charts=fit_charts(fit),
        unknown_heads=UNKNOWN_HEADS,
        unknown_rows=unknown_rows(fit),
        record_heads=RECORD_HEADS,
        record_rows=record_rows(fit),
        candidate_heads=candidate_heads(fit) if has_next else [],
        candidate_rows=candidate_rows(fit) if has_next else [],
        base=base.read_text(encoding="utf-8") if base.is_file() else "",
    )
    return write_listed(directory / "report" / "index.html", page)
