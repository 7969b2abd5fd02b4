"""The page of a comparison with a measurement."""

import json
from pathlib import Path

import xarray as xr

from tripod_doe.analyses.comparison.charts import comparison_charts
from tripod_doe.analyses.comparison.sentences import ORDER_HEADS, find_in_comparison, order_rows
from tripod_doe.atomic_files import replace_text
from tripod_doe.checksum_list import write_listed
from tripod_doe.page_parts.answer import answer_first
from tripod_doe.page_parts.main_results import spoken, unit_text
from tripod_doe.page_parts.templates import render
from tripod_doe.quantities import level, with_unit
from tripod_doe.study.cube.netcdf import stamp_history, write_dataset


def comparison_page(comparison: xr.Dataset) -> str:
    """The comparison as one self-contained HTML page."""
    point = json.loads(comparison.attrs["point"])
    units = json.loads(comparison.attrs["point_units"])
    facts = [
        (spoken(name), with_unit(level(value), unit_text(units.get(name, "1"))) if isinstance(value, float) else value)
        for name, value in point.items()
    ]
    sentences, more = answer_first(find_in_comparison(comparison))
    return render(
        "comparison.html",
        attrs=comparison.attrs,
        facts=facts,
        sentences=sentences,
        more=more,
        charts=comparison_charts(comparison),
        heads=ORDER_HEADS,
        rows=order_rows(comparison),
    )


def is_page(output: Path) -> bool:
    """Whether a path names one page, not a folder."""
    return output.suffix.lower() in (".html", ".htm")


def write_comparison(comparison: xr.Dataset, output: Path) -> Path:
    """Write the page: to a file that ends in .html, else as index.html into a directory, with comparison.nc beside it.

    Raises:
        StorageError: If it cannot be written.
    """
    if is_page(output):
        return replace_text(output, comparison_page(comparison))
    page = write_listed(output / "index.html", comparison_page(comparison))
    write_dataset(stamp_history(comparison, "tripod-doe compare"), output / "comparison.nc")
    return page
