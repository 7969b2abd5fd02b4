"""Pages of comparisons: of one record, and the overview of many as text and as a page with one for each."""

import json
import math
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr

from tripod_doe.analyses.comparison.charts import comparison_charts
from tripod_doe.analyses.comparison.comparison import AGREES, DIFFERS, NONE_IN_MODEL, NOT_COMPARED, UNDECIDED, VERDICTS
from tripod_doe.analyses.comparison.overview import OverviewRow, overview_csv, overview_rows
from tripod_doe.analyses.comparison.record_comparison import ComparedRecord
from tripod_doe.analyses.comparison.sentences import (
    ORDER_HEADS,
    asymmetry_text,
    cause_text,
    find_in_comparison,
    nothing_decided,
    order_rows,
    orders_text,
    too_small_text,
)
from tripod_doe.errors import InputError, printable
from tripod_doe.files.atomic_files import replace_text
from tripod_doe.files.checksum_list import write_listed
from tripod_doe.joint.parameters import JOINT_PARAMETERS
from tripod_doe.number_text import count_of, interval, level, with_unit
from tripod_doe.page_parts.answer import answer_first
from tripod_doe.page_parts.charts.chart import Chart
from tripod_doe.page_parts.charts.orders import agreement, differences
from tripod_doe.page_parts.templates import render
from tripod_doe.page_parts.words import ORDINALS, listed, spoken, unit_text
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
    """Write the page: to a file that ends in .html, else as index.html into a directory, with comparison.nc next to it.

    Raises:
        StorageError: If it cannot be written.
    """
    if is_page(output):
        return replace_text(output, comparison_page(comparison))
    page = write_listed(output / "index.html", comparison_page(comparison))
    write_dataset(stamp_history(comparison, "tripod-doe compare"), output / "comparison.nc")
    return page


_SHOWN = (3, 2)
"""Orders in texts and on the page; the CSV file has all."""
_OVER = ("joint_angle_deg", "torque_n_m", "speed_rpm")
_FOLDER = "records"
_NOT, _NONE = VERDICTS[NOT_COMPARED], VERDICTS[NONE_IN_MODEL]


def overview_text(records: Sequence[ComparedRecord]) -> str:
    """Findings, and a line for the second and the third order of each record."""
    lines = overview_sentences(records)
    for row in overview_rows(records):
        if row.order in _SHOWN and row.verdict != _NOT:
            measured, computed = (
                interval(row.measured, row.measured_error),
                interval(row.computed, row.computed_error),
            )
            lines.append(
                f"  {row.file}, order {row.order}: measured {measured} N, computed {computed} N, {row.verdict}"
            )
    return "\n".join(map(printable, lines))


def overview_sentences(records: Sequence[ComparedRecord]) -> list[str]:
    """Number of records that agree in each shown order, and the records that were not compared."""
    rows = overview_rows(records)
    sentences = _differing_orders(rows)
    for order in _SHOWN:
        own = [row for row in rows if row.order == order and row.verdict not in (_NOT, _NONE)]
        if not own:
            continue
        agreeing = f"{sum(row.verdict == AGREES for row in own) or 'none'} of {count_of(len(own), 'record')}"
        if small := sum(row.verdict == UNDECIDED for row in own):
            agreeing += f" and is too small to tell in {small}"
        worst = max(own, key=lambda row: abs(row.measured - row.computed))
        sentences.append(
            f"The {ORDINALS[order]} agrees within the uncertainties in {agreeing}; the largest difference is in "
            f"{worst.file}: measured {interval(worst.measured, worst.measured_error)} N, computed "
            f"{interval(worst.computed, worst.computed_error)} N."
        )
    simulated = [record.name for record in records if record.simulated]
    if simulated:
        sentences.append(f"The cube lacks the points of {listed(simulated)}, which were simulated.")
    sentences += [f"{record.name}: {record.replaced}" for record in records if record.replaced]
    sentences += _origins(records)
    sentences += [f"{record.name} was not compared: {record.problem}" for record in records if record.problem]
    return sentences


def _differing_orders(rows: Sequence[OverviewRow]) -> list[str]:
    """Which orders differ, and in how many records; which agree in all; which the model does not have."""
    compared = [row for row in rows if row.verdict != _NOT]
    every = count_of(len(compared) // 12, "record")
    if not compared:
        return []
    differing, lacking, agreeing = (
        Counter(row.order for row in compared if row.verdict == verdict) for verdict in (DIFFERS, _NONE, AGREES)
    )
    rest = [order for order in range(1, 13) if not differing[order] and not lacking[order]]
    same = [order for order in rest if agreeing[order] == len(compared) // 12]
    partly = [order for order in rest if 0 < agreeing[order] < len(compared) // 12]
    small = [order for order in rest if not agreeing[order]]
    perhaps = f" or {'are' if len(partly) > 1 else 'is'} too small to tell"
    others = (f"; {_agree(partly).lower()}{perhaps}" if partly else "") + too_small_text(small)
    within = "within the uncertainties of measurement and model together"
    sentences = []
    if differing:
        agree = f"; {_agree(same).lower()} in all" if same else ""
        sentences = [
            "Differences beyond the uncertainties of measurement and model together: "
            f"{_by_count(differing)} of {every}{agree}{others}."
        ]
    elif same:
        which = "Orders 1 to 12 all agree" if len(same) == 12 else _agree(same)
        sentences = [f"{which} {within} in {every}{others}."]
    elif partly:
        sentences = [f"{_agree(partly)} {within}{perhaps}, in {every}{too_small_text(small)}."]
    elif small:
        sentences = [nothing_decided(small)]
    for multiple in (False, True):
        if group := Counter({order: count for order, count in lacking.items() if (order % 3 == 0) is multiple}):
            sentences.append(
                f"{asymmetry_text(sorted(group))}; records have more there than their scatter ({_by_count(group)} of "
                f"{every}): {cause_text(sorted(group))}."
            )
    return sentences


def _agree(orders: Sequence[int]) -> str:
    return f"{orders_text(orders)} agree{'s' * (len(orders) == 1)}"


def _by_count(orders: Counter[int]) -> str:
    """Orders with the number of records, the most frequent first."""
    by_count = {some: [order for order in orders if orders[order] == some] for some in {*orders.values()}}
    return listed([f"{orders_text(by_count[some]).lower()} in {some}" for some in sorted(by_count, reverse=True)])


def _origins(records: Sequence[ComparedRecord]) -> list[str]:
    """Where the error of the model comes from, once for all records of the same origin."""
    stated = [each.comparison.attrs for each in records if each.comparison is not None]
    known = dict.fromkeys((attrs["model"], attrs["model_uncertainty_origin"]) for attrs in stated)
    if not all(origin for _, origin in known):
        return ["The error of the model is not known here: the verdicts count the measurement's alone."]
    return [f"Error of the model {model}: {origin}." for model, origin in known]


def write_record(record: ComparedRecord, output: Path) -> Path:
    """Write the page of one record: as a file, or into a directory with comparison.nc and overview.csv.

    Raises:
        StorageError: If it cannot be written.
    """
    if record.comparison is None:
        raise InputError(record.problem)
    page = write_comparison(record.comparison, output)
    if not is_page(output):
        write_listed(output / "overview.csv", overview_csv(overview_rows([record])))
    return page


def write_overview(records: Sequence[ComparedRecord], study: str, output: Path) -> Path:
    """Write the overview into a directory: overview.csv, index.html, and a folder with a page for each record.

    Args:
        records: The records.
        study: Title of the study that they were compared with.
        output: The directory.

    Returns:
        The page.

    Raises:
        StorageError: If it cannot be written.
    """
    rows = overview_rows(records)
    write_listed(output / "overview.csv", overview_csv(rows))
    links = []
    for at, record in enumerate(records, start=1):
        folder = f"{at:03}-{re.sub(r'[^A-Za-z0-9_-]+', '-', record.row.path.stem)[:60]}"
        links.append(f"{_FOLDER}/{folder}/index.html")
        if record.comparison is not None:
            write_comparison(record.comparison, output / _FOLDER / folder)
    differing = _differing(records)
    heads = [f"{ORDINALS[order]}: {word}" for order in _SHOWN for word in ("measured", "computed", "verdict")]
    by_record = [rows[at : at + len(rows) // len(records)] for at in range(0, len(rows), len(rows) // len(records))]
    page = render(
        "overview.html",
        records=records,
        study=study,
        sentences=overview_sentences(records),
        heads=["Record", *map(spoken, differing), *heads],
        rows=[(record, _cells(record, own, differing)) for record, own in zip(records, by_record, strict=True)],
        links=links,
        problems=[record for record in records if record.problem],
        charts=_charts(records, rows),
    )
    return write_listed(output / "index.html", page)


def _cells(record: ComparedRecord, rows: Sequence[OverviewRow], differing: Sequence[str]) -> list[str]:
    values = [record.row.values.get(name, "") for name in differing]
    cells = [
        with_unit(level(value), unit_text(JOINT_PARAMETERS[name].unit)) if isinstance(value, int | float) else value
        for name, value in zip(differing, values, strict=True)
    ]
    for row in (row for order in _SHOWN for row in rows if row.order == order):
        if row.verdict == _NOT:
            cells += ["", "", row.verdict]
        else:
            cells += [
                interval(row.measured, row.measured_error),
                interval(row.computed, row.computed_error),
                row.verdict,
            ]
    return cells


def _differing(records: Sequence[ComparedRecord]) -> list[str]:
    """Parameters in which the records differ."""
    names = dict.fromkeys(name for record in records for name in record.row.values)
    return [name for name in names if len({record.row.values.get(name) for record in records}) > 1]


def _charts(records: Sequence[ComparedRecord], rows: Sequence[OverviewRow]) -> list[Chart]:
    """Computed over measured amplitudes, and differences over what varies between the records."""
    data = pd.DataFrame([asdict(row) for row in rows if row.order in _SHOWN and row.verdict != _NOT])
    if data.empty:
        return []
    charts = [_agreement(data)]
    values = {record.name: record.row.values for record in records}
    for name in _OVER:
        own = data.assign(**{name: [values[file].get(name, math.nan) for file in data["file"]]})
        if own[name].nunique() > 1:
            charts.append(_differences(own, name))
    return charts


def _agreement(data: pd.DataFrame) -> Chart:
    figure = agreement(data, "computed", "computed_error", data.iloc[:0])
    caption = "Computed over measured amplitudes with the 95 % uncertainties of both; the line is agreement."
    return Chart("agreement", "Measured and computed", caption, figure, data)


def _differences(data: pd.DataFrame, name: str) -> Chart:
    shown = data.assign(difference=data["measured"] - data["computed"])
    unsure = np.hypot(shown["measured_error"], shown["computed_error"].fillna(0))
    shown = shown.assign(uncertainty=unsure)[["file", "order", name, "difference", "uncertainty"]]
    figure = differences(shown, name, "difference", "measured minus computed (N)")
    caption = f"Differences over {spoken(name)}, with the 95 % uncertainty of measurement and model together."
    return Chart(f"difference-{name}", f"Differences over {spoken(name)}", caption, figure, shown)
