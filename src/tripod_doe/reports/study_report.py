"""The report of a result directory: one self-contained HTML file, made from its cubes."""

from __future__ import annotations

import json
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import xarray as xr

from tripod_doe.analyses.claims.skew_charts import findings_over_skew_charts, kept_skew_charts
from tripod_doe.analyses.contribution.charts import contribution_charts
from tripod_doe.analyses.contribution.sentences import contribution_notes
from tripod_doe.analyses.contribution.share_tables import contributions, share_rows
from tripod_doe.analyses.failing_region.charts import failing_region_chart
from tripod_doe.analyses.findings import find
from tripod_doe.analyses.kinds import kind_of, of_kind
from tripod_doe.analyses.main_effects.charts import effect_charts
from tripod_doe.analyses.model_choice.charts import model_choice_chart
from tripod_doe.analyses.registry import findings_of_all, section_charts, table_of
from tripod_doe.analyses.sensitivity import RANKED
from tripod_doe.analyses.sensitivity.sentences import sensitivity_parts
from tripod_doe.analyses.surrogate.what_if_page import WhatIfPage, what_if_pages
from tripod_doe.errors import InputError
from tripod_doe.files.atomic_files import refuse_links
from tripod_doe.files.checksum_list import write_listed
from tripod_doe.model_interface import NOTABLE_ERROR
from tripod_doe.page_parts.answer import answer_first, picture_first
from tripod_doe.page_parts.charts.chart import Chart
from tripod_doe.page_parts.charts.needle_locus import locus_chart
from tripod_doe.page_parts.charts.waveforms import spectrum_chart, waveform_charts
from tripod_doe.page_parts.chosen_models import asked_orders
from tripod_doe.page_parts.main_results import (
    asked,
    design_kind,
    factor_names,
    finished,
    points_in_words,
    representative_points,
    study_tables,
    waiting,
)
from tripod_doe.page_parts.subset import shown_subset
from tripod_doe.page_parts.tables import (
    cost_rows,
    factor_rows,
    failed_points,
    fixed_rows,
    numerics_rows,
    outcome_counts,
)
from tripod_doe.page_parts.templates import render
from tripod_doe.page_parts.words import factor_unit, spoken
from tripod_doe.reports.joint_drawing import drawn_joint
from tripod_doe.study.cube.file_checks import analysis_files
from tripod_doe.study.cube.file_digest import stored_digest
from tripod_doe.study.cube.lazy_dataset import read_dataset
from tripod_doe.study.cube.model_records import MODEL_ERROR
from tripod_doe.study.result_directory.annotation import Annotation, read_annotation
from tripod_doe.study.result_directory.latest_run import failed_analyses
from tripod_doe.study.result_directory.open_cube import is_shown, opened_study

_MOST_FAILED = 50
_SECTIONS = {
    "tables": "Tables",
    "models": "Models",
    "borders": "Maps",
    "contribution": "Contribution",
    "loci": "Loci",
    "effects": "Effects",
    "sensitivity": "Sensitivity",
    "waveforms": "Waveforms",
    "spectrum": "Orders",
    "skews": "Needle skew",
    "region": "Where points fail",
    "failed": "Unfinished points",
    "motion": "The joint in motion",
    "cost": "Cost",
    "setting": "Parameters",
    "provenance": "Provenance",
}
_ALWAYS = {"setting", "provenance"}  # other sections are shown only if they have content
_FILES = ("cube.nc", "cost.nc", "study.toml")


def write_report(directory: str | Path, findings: Sequence[str] | None = None, motion: str = "") -> Path:
    """Make the report of a result directory from its cube, costs and analyses, or from the points finished so far.

    Args:
        findings: Result of `find` for its cube, if already known.
        motion: A page that animates the joint at points of the study, to show in the report.

    Returns:
        The report, ``directory/report/index.html``; replaces an older report completely.

    Raises:
        CubeError: If the cube or an analysis is missing or damaged.
        InputError: If the path is a file, not a directory, or another command changes the results meanwhile.
        StorageError: If the report cannot be written; an older one stays.
    """
    directory = Path(directory)
    if directory.is_file():
        raise InputError(f"{directory}: this is a file; a report is made of the result directory it lies in")
    refuse_links(directory)
    complete, digest = is_shown(directory), _cube_digest(directory)  # not complete: its analyses have fewer points
    analyses = read_analyses(directory) if complete else {}
    files = [name for name in _FILES if complete and (directory / name).is_file()]
    files += [f"analysis/{name}.nc" for name in analyses]
    with opened_study(directory) as cube:
        named = study_tables(cube).get("analysis", {}) if complete else {}
        failed = failed_analyses(directory)
        missing = [
            f"Analysis {name} was not made: {failed.get(name, 'run the study again with the same --out to read why')}."
            for name in named
            if name not in analyses
        ]
        findings = [*(find(cube) if findings is None else findings), *missing]
        page = make_page(cube, analyses, files, findings, read_annotation(directory), motion)
    if (complete, digest) != (is_shown(directory), _cube_digest(directory)):
        raise InputError(f"{directory}: another command changed these results while their report was made; try again")
    return write_listed(directory / "report" / "index.html", page)


def _cube_digest(directory: Path) -> str:
    """The digest of the cube in a result directory; empty if there is none."""
    cube = directory / "cube.nc"
    return stored_digest(cube) if cube.is_file() else ""


def read_analyses(directory: Path) -> dict[str, xr.Dataset]:
    """The analyses of a result directory by their names; CubeError if one is damaged or of another study."""
    return {name: read_dataset(path) for name, path in analysis_files(directory).items()}


def make_page(
    cube: xr.Dataset,
    analyses: Mapping[str, xr.Dataset],
    files: Sequence[str] = (),
    findings: Sequence[str] | None = None,
    annotation: Annotation | None = None,
    motion: str = "",
) -> str:
    """The report as HTML: the same cube and analyses give the same text.

    Args:
        files: Files of the result directory, relative to it, to which the page links.
        findings: Result of `find` for the cube, if already known.
        annotation: The annotation of the results.
        motion: A page that animates the joint.
    """
    shown = representative_points(shown_subset(cube))
    said = answered(cube, analyses, findings)
    content = said.content
    lost, left = int((asked(cube) & ~finished(cube)).sum() - waiting(cube).sum()), int(waiting(cube).sum())
    silent = [
        name
        for name, result in of_kind(analyses, *RANKED).items()
        if not sensitivity_parts(result) and (kind_of(result) != "multifidelity" or "ST" in result)
    ]
    questions, not_asked = what_if_pages(analyses), asked_orders(cube) is not None
    others = {"sensitivity": silent, "failed": lost or left, "models": not_asked, "motion": motion}
    filled = {name for name, part in [*content.items(), *others.items()] if part}
    return render(
        "page.html",
        attrs=cube.attrs,
        annotation=annotation or Annotation(),
        files=files,
        design=design_kind(cube),
        total=int(asked(cube).sum()),
        good=int(finished(cube).sum()),
        lost=lost,
        left=left,
        sentences=said.sentences,
        notes=str(cube.attrs.get("model_notes", "")).splitlines(),
        notable=MODEL_ERROR in cube and bool((cube[MODEL_ERROR] > NOTABLE_ERROR).any()),
        not_asked=not_asked,
        more=said.more,
        picture=said.picture,
        what_ifs=questions,
        sections=_sections(filled | _ALWAYS, questions),
        silent=silent,
        points_in_words=points_in_words(shown),
        outcomes=outcome_counts(cube),
        factor_heads=[(spoken(name), factor_unit(cube, name)) for name in factor_names(cube)],
        numerics=numerics_rows(cube),
        factors=factor_rows(cube),
        fixed=fixed_rows(cube),
        joint=drawn_joint(cube),
        motion=motion,
        packages=json.loads(str(cube.attrs.get("package_versions", "{}"))),
        histories={name: data.attrs.get("history", "") for name, data in {"cube": cube, **analyses}.items()},
        **content,
    )


@dataclass(frozen=True)
class Answer:
    """The answer of a study, its other findings, and the content of its page."""

    sentences: list[str]  # at most three
    more: list[str]  # all others
    picture: Chart | None  # the picture that shows the answer
    content: dict[str, Any]  # content of each section, without the picture

    @property
    def charts(self) -> list[Chart]:
        """All charts, the picture first."""
        return ([self.picture] if self.picture else []) + list(_charts_in(list(self.content.values())))


def _charts_in(content: object) -> Iterator[Chart]:
    if isinstance(content, Chart):
        yield content
    for inner in content if isinstance(content, list | tuple) else ():
        yield from _charts_in(inner)


def answered(cube: xr.Dataset, analyses: Mapping[str, xr.Dataset], findings: Sequence[str] | None = None) -> Answer:
    """Sentences, picture and charts of a cube and its analyses; see `make_page`."""
    part = shown_subset(cube)
    said = findings_of_all(analyses)
    sentences, more = answer_first(_in_order(cube, find(cube) if findings is None else findings, said))
    picture, content = _content(cube, part, representative_points(part), analyses)
    return Answer(sentences, more, picture, content)


def _sections(filled: Collection[str], questions: Sequence[WhatIfPage]) -> dict[str, str]:
    """Titles of the existing sections, by the names of their places."""
    sections: dict[str, str] = {}
    for name, title in _SECTIONS.items():
        if name == "waveforms":
            sections |= {f"what-if-{each.name}": "What if" for each in questions}
        if name in filled:
            sections[name] = title
    return sections


def _content(
    cube: xr.Dataset, part: xr.Dataset, shown: xr.Dataset, analyses: Mapping[str, xr.Dataset]
) -> tuple[Chart | None, dict[str, Any]]:
    """The picture at the top of the page, and the content of each section: the other charts, and rows.

    Rows use the whole cube; charts use the shown points, or the points that represent the joint.
    """
    parts = contributions(analyses)
    shares = [[] if part.missing else contribution_charts(part) for part in parts]
    effects = effect_charts(shown)
    charts = _charts(part, shown, analyses)
    picture = picture_first(
        [
            charts["models"],
            charts["borders"],
            *shares,
            charts["sensitivity"],
            charts["loci"],
            [group.strongest for group in effects],
            *charts.values(),
        ]
    )
    return picture, {name: _charts_without(picture, group) for name, group in charts.items()} | {
        "tables": [
            (result.attrs.get("title", name), *table)
            for name, result in analyses.items()
            if (table := table_of(result))
        ],
        "contribution": [
            (
                part,
                contribution_notes(part),
                _charts_without(picture, group),
                None if part.missing else share_rows(part),
            )
            for part, group in zip(parts, shares, strict=True)
        ],
        "effects": [(group.response, rest) for group in effects if (rest := _charts_without(picture, group.charts))],
        "cost": cost_rows(cube),
        "failed": failed_points(cube, _MOST_FAILED),
    }


def _in_order(cube: xr.Dataset, findings: Sequence[str], said: Sequence[str]) -> list[str]:
    """Findings of the analyses, then of the cube; a finding that most points have no result comes first."""
    most_missing = int(finished(cube).sum()) < int(asked(cube).sum()) / 2
    return [*findings[:1], *said, *findings[1:]] if most_missing else [*said, *findings]


def _charts(cube: xr.Dataset, shown: xr.Dataset, analyses: Mapping[str, xr.Dataset]) -> dict[str, list[Chart]]:
    """The charts of each section that holds nothing else."""
    loci, choice = locus_chart(shown), model_choice_chart(cube)
    every_order = asked_orders(cube) is None  # else other orders come from models with different errors
    spectrum = spectrum_chart(shown) if every_order else None
    return {
        "models": [choice] if choice else [],
        "borders": section_charts("borders", analyses),
        "sensitivity": section_charts("sensitivity", analyses),
        "region": [region] if (region := failing_region_chart(cube)) else [],
        "loci": [loci] if loci else [],
        "waveforms": waveform_charts(shown) if every_order else [],
        "spectrum": [spectrum] if spectrum else [],
        "skews": kept_skew_charts(shown) + findings_over_skew_charts(shown),
    }


def _charts_without(picture: Chart | None, charts: list[Chart]) -> list[Chart]:
    """The charts without the chart at the top of the page."""
    return [chart for chart in charts if chart is not picture]
