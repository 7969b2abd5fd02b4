"""The report of a result directory: one self-contained HTML file, made from its cubes."""

from __future__ import annotations

import base64
import json
import re
from collections.abc import Mapping
from pathlib import Path

import xarray as xr
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from tripod_doe.analysis.kinds import of_kind
from tripod_doe.atomic_files import replace_text
from tripod_doe.errors import InputError
from tripod_doe.report.analyses import findings_of
from tripod_doe.report.contribution_sentences import contribution_notes
from tripod_doe.report.contributions import contributions, share_rows
from tripod_doe.report.figures import (
    Chart,
    contribution_charts,
    effect_charts,
    findings_over_skew_charts,
    index_charts,
    kept_skew_charts,
    locus_chart,
    model_choice_chart,
    spectrum_chart,
    waveform_charts,
)
from tripod_doe.report.findings import find
from tripod_doe.report.model_choice import asked_orders
from tripod_doe.report.responses import asked, design_kind, factor_names, factor_unit, finished, spoken, with_all_on
from tripod_doe.report.tables import (
    cost_rows,
    factor_rows,
    failed_points,
    fixed_rows,
    numerics_rows,
    outcome_counts,
)
from tripod_doe.simulator import NOTABLE_ERROR
from tripod_doe.study.model_records import MODEL_ERROR
from tripod_doe.study.netcdf import read_dataset
from tripod_doe.study.results import is_shown, open_cube

__all__ = ["make_page", "read_analyses", "render", "write_report"]

_MOST_FAILED = 50


def write_report(directory: Path) -> Path:
    """Make the report of a result directory from its cube, costs and analyses, or from the points finished so far.

    Parameters
    ----------
    directory
        A result directory.

    Returns
    -------
    pathlib.Path
        The report, ``directory/report/index.html``; an older one is replaced whole.

    Raises
    ------
    CubeError
        If the cube or an analysis is missing or damaged.
    InputError
        If this is a file and no directory.
    StorageError
        If the report cannot be written; an older one stays.
    """
    directory = Path(directory)
    if directory.is_file():
        raise InputError(f"{directory}: this is a file; a report is made of the result directory it lies in")
    complete = is_shown(directory)  # else the analyses there, if any, are of fewer points than the cube
    cube = open_cube(directory)
    analyses = read_analyses(directory) if complete else {}
    return replace_text(directory / "report" / "index.html", make_page(cube, analyses))


def read_analyses(directory: Path) -> dict[str, xr.Dataset]:
    """The analyses of a result directory by their names."""
    return {path.stem: read_dataset(path) for path in sorted((directory / "analysis").glob("*.nc"))}


def make_page(cube: xr.Dataset, analyses: Mapping[str, xr.Dataset]) -> str:
    """The report as HTML: the same cube and analyses give the same text.

    Parameters
    ----------
    cube
        A result cube, with its costs where they are known.
    analyses
        Analyses of it by name.
    """
    total, good = int(asked(cube).sum()), int(finished(cube).sum())
    shown = with_all_on(cube)
    return render(
        "page.html",
        attrs=cube.attrs,
        design=design_kind(cube),
        total=total,
        good=good,
        findings=find(cube),
        answers=[sentence for name, result in analyses.items() for sentence in findings_of(name, result)],
        loci=locus_chart(shown),
        model_notes=str(cube.attrs.get("model_notes", "")).splitlines(),
        notable=MODEL_ERROR in cube and bool((cube[MODEL_ERROR] > NOTABLE_ERROR).any()),
        choice=model_choice_chart(cube),
        asked_orders=asked_orders(cube),
        waveforms=waveform_charts(shown) if asked_orders(cube) is None else [],
        spectrum=spectrum_chart(shown) if asked_orders(cube) is None else None,
        skews=kept_skew_charts(shown) + findings_over_skew_charts(shown),
        effects=effect_charts(shown),
        indices=index_charts(analyses, cube),
        contributions=[
            (part, contribution_notes(part), None if part.missing else (contribution_charts(part), share_rows(part)))
            for part in contributions(analyses)
        ],
        ablation=shown is not cube,
        analyses=of_kind(analyses, "sobol", "morris"),
        outcomes=outcome_counts(cube),
        factor_heads=[(spoken(name), factor_unit(cube, name)) for name in factor_names(cube)],
        failed=failed_points(cube, _MOST_FAILED),
        costs=cost_rows(cube),
        numerics=numerics_rows(cube),
        factors=factor_rows(cube),
        fixed=fixed_rows(cube),
        packages=json.loads(str(cube.attrs.get("package_versions", "{}"))),
        histories={name: data.attrs.get("history", "") for name, data in {"cube": cube, **analyses}.items()},
    )  # fmt: skip


def render(template: str, **content: object) -> str:
    """A page from one of the templates beside this module; text is escaped, charts are drawn inline."""
    environment = Environment(
        loader=PackageLoader("tripod_doe.report", "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"typeset": _typeset, "csv_link": _csv_link, "svg": _svg}
    return environment.get_template(template).render(**content)


def _typeset(text: str) -> str:
    """Plain-text sentences with the signs of print."""
    text = text.replace(" +- ", "\u00a0±\u00a0").replace("R2 = ", "R²\u00a0=\u00a0").replace("R^2", "R²")
    text = re.sub(r"\b(?:at (?:most|least)|Figs?\.) (?=[-\d])", lambda found: found[0].replace(" ", "\u00a0"), text)
    text = text.replace("Sobol' ", "Sobol’ ")
    text = text.replace("N m", "N\u00a0m")
    text = re.sub(r"(?<=\d) (?=(?:N|deg|mm|um|rpm|%))", "\u00a0", text)
    return re.sub(r"(?<![\w.])-(?=\d)", "−", text)


def _svg(chart: Chart) -> Markup:
    """The figure inline; its caption is its text alternative."""
    return Markup(chart.svg().replace("<svg", Markup('<svg role="img" aria-label="{}"').format(chart.caption), 1))


def _csv_link(chart: Chart) -> str:
    return "data:text/csv;base64," + base64.b64encode(chart.csv().encode()).decode()
