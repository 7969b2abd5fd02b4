"""All analyses and figures: one row each, with its function, its settings, and the place of its sentences and charts.

To add an analysis, write its function, decorated with `makes_kind`, and a model of its settings, and add a row here.
Sentences, table and figures are optional. They are named as ``module:function`` below `tripod_doe.analyses` and
imported when they are needed, so that a computation without charts imports no plotting.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import wraps
from importlib import import_module
from typing import TYPE_CHECKING, Any

import xarray as xr
from pydantic import BaseModel

from tripod_doe.analyses.claims.over_skew import ClaimsOverSkewSettings, claims_over_skew
from tripod_doe.analyses.claims.verdicts import ClaimsSettings, check_claims, claims_json
from tripod_doe.analyses.comparison.record_comparison import ComparisonSettings, compare_file
from tripod_doe.analyses.contribution.contribution import ContributionSettings, contribution_shares
from tripod_doe.analyses.factorial_effects.factorial_effects import EFFECT_DESIGNS, EffectsSettings, factorial_effects
from tripod_doe.analyses.kinds import MADE, is_study, kind_made_by, kind_of
from tripod_doe.analyses.model_choice.selection import ChooseSettings, choose_for_study
from tripod_doe.analyses.multifidelity.multifidelity import MultifidelitySettings, multifidelity
from tripod_doe.analyses.sensitivity.delta import borgonovo_delta
from tripod_doe.analyses.sensitivity.dgsm import DgsmSettings, derivative_measures
from tripod_doe.analyses.sensitivity.fast import fast_indices
from tripod_doe.analyses.sensitivity.morris import MorrisSettings, morris_effects
from tripod_doe.analyses.sensitivity.pawn import ChanceSettings, PawnSettings, pawn_indices
from tripod_doe.analyses.sensitivity.rbd_fast import FEWEST, rbd_fast_indices
from tripod_doe.analyses.sensitivity.shapley import shapley_effects
from tripod_doe.analyses.sensitivity.sobol import sobol_indices
from tripod_doe.analyses.settings import PointSettings, SensitivitySettings
from tripod_doe.analyses.speed_accuracy.speed_accuracy import SpeedAccuracySettings, speed_accuracy
from tripod_doe.analyses.stability.stability import StabilitySettings, stability_borders
from tripod_doe.analyses.surrogate.surrogate import SURROGATE_DESIGNS, SurrogateSettings, surrogate
from tripod_doe.analyses.tolerance.tolerance import ToleranceSettings, tolerance
from tripod_doe.analyses.usable_points import SAMPLED_DESIGNS
from tripod_doe.errors import CubeError, InputError
from tripod_doe.page_parts.main_outputs import answered_range
from tripod_doe.study.definition.study_folder import StudyFolder

if TYPE_CHECKING:
    from tripod_doe.page_parts.charts.chart import Chart

Table = tuple[list[str], list[list[str]]]
"""Heads and rows."""

Function = Callable[[Mapping[str, xr.Dataset], Any, StudyFolder], xr.Dataset]
"""(cubes by the names of their steps, settings, folder of the workflow file) -> result."""


def _of_cube(function: Callable[[xr.Dataset, Any], xr.Dataset]) -> Function:
    """An analysis of the only cube among its inputs."""

    @wraps(function)
    def analysis(cubes: Mapping[str, xr.Dataset], settings: Any, folder: StudyFolder) -> xr.Dataset:
        (cube,) = cubes.values()
        return function(cube, settings)

    return analysis


def _of_cubes(function: Callable[[Mapping[str, xr.Dataset], Any], xr.Dataset]) -> Function:
    """An analysis that reads no files besides its cubes."""

    @wraps(function)
    def analysis(cubes: Mapping[str, xr.Dataset], settings: Any, folder: StudyFolder) -> xr.Dataset:
        return function(cubes, settings)

    return analysis


@dataclass(frozen=True)
class Analysis:
    """One kind of analysis."""

    function: Function  # makes the result, whose attribute ``analysis_kind`` is the kind
    settings: type[BaseModel]  # its settings: [analysis.NAME] of a study, [steps.NAME.settings] of a workflow
    # design kinds of the studies whose cube it can read; empty where only a workflow can ask for it
    designs: tuple[str, ...] = ()
    independent: bool = False  # whether the factors of these designs must not depend on each other
    fewest: int = 0  # samples that it needs
    crossed: bool = False  # whether such a design may also be a part of a product
    # settings that name files, relative to the workflow file; their contents are part of the step's inputs
    files: tuple[str, ...] = ()
    runs: tuple[str, ...] = ()  # settings by which its study runs other points, which a step of a workflow cannot
    # whether it can read the cubes of failed studies: it knows which points did not finish, and reports them
    partial: bool = False
    sentences: str = ""  # (result, name of the analysis) -> list of sentences
    table: str = ""  # result -> heads and rows of a table for a page
    # by the names that workflow files use: (result, name of the analysis) -> list of charts
    figures: Mapping[str, str] = field(default_factory=dict)
    section: str = ""  # section of a study's page that shows all its figures; empty for none
    # for the answer to a workflow's question: a file of the result directory for other programs, and how its text is
    # made. The page of the workflow shows such an answer first.
    export: tuple[str, Callable[[xr.Dataset], str]] | None = None

    @property
    def kind(self) -> str:
        """The name that study and workflow files use."""
        return kind_made_by(self.function)


_INDEX_CHARTS = {"indices": "sensitivity.charts:index_charts"}


def _indices(
    function: Callable[[xr.Dataset, Any], xr.Dataset],
    settings: type[BaseModel],
    *designs: str,
    independent: bool = False,
    fewest: int = 0,
) -> Analysis:
    """The row of a sensitivity analysis that ranks the factors by an index."""
    return Analysis(
        _of_cube(function),
        settings,
        designs,
        independent,
        fewest,
        sentences="sensitivity.sentences:find_in_sensitivity",
        figures=_INDEX_CHARTS,
        section="sensitivity",
    )


ANALYSES: dict[str, Analysis] = {
    row.kind: row
    for row in (
        _indices(sobol_indices, SensitivitySettings, "saltelli"),
        _indices(morris_effects, MorrisSettings, "morris"),
        _indices(fast_indices, PointSettings, "fast"),
        _indices(rbd_fast_indices, SensitivitySettings, *SAMPLED_DESIGNS, independent=True, fewest=FEWEST),
        _indices(pawn_indices, PawnSettings, *SAMPLED_DESIGNS),
        _indices(borgonovo_delta, ChanceSettings, *SAMPLED_DESIGNS),
        _indices(derivative_measures, DgsmSettings, "finite-differences"),
        _indices(shapley_effects, SensitivitySettings, "latin-hypercube", "rbd-fast"),
        Analysis(
            _of_cube(factorial_effects),
            EffectsSettings,
            EFFECT_DESIGNS,
            sentences="factorial_effects.sentences:find_in_effects",
            table="factorial_effects.sentences:effect_table",
            figures={"factorial-effects": "factorial_effects.charts:factorial_effect_charts"},
            section="sensitivity",
        ),
        Analysis(
            _of_cube(tolerance),
            ToleranceSettings,
            SAMPLED_DESIGNS,
            sentences="tolerance.sentences:find_in_tolerance",
            runs=("confirm",),
            table="tolerance.sentences:tolerance_table",
            figures={"tolerance": "tolerance.charts:tolerance_charts"},
            section="sensitivity",
        ),
        Analysis(
            _of_cube(multifidelity),
            MultifidelitySettings,
            ("multifidelity",),
            sentences="multifidelity.sentences:find_in_multifidelity",
            table="multifidelity.sentences:model_table",
            figures=_INDEX_CHARTS | {"multifidelity": "multifidelity.charts:multifidelity_charts"},
            section="sensitivity",
        ),
        Analysis(
            _of_cube(surrogate),
            SurrogateSettings,
            SURROGATE_DESIGNS,
            sentences="surrogate.sentences:find_in_surrogate",
            figures={"surrogate": "surrogate.charts:surrogate_charts"},
            section="sensitivity",
        ),
        Analysis(
            _of_cube(contribution_shares),
            ContributionSettings,
            ("ablation",),
            crossed=True,
            sentences="contribution.sentences:find_in_contribution",
            table="contribution.sentences:contribution_table",
            figures={"contribution": "contribution.charts:contribution_figures"},
        ),
        Analysis(
            _of_cube(stability_borders),
            StabilitySettings,
            ("grid", "product"),
            sentences="stability.sentences:find_in_stability",
            table="stability.sentences:stability_table",
            figures={"stability-map": "stability.charts:stability_charts"},
            section="borders",
        ),
        Analysis(
            compare_file,
            ComparisonSettings,
            files=("measurement",),
            sentences="comparison.sentences:find_in_comparison",
            figures={"comparison": "comparison.charts:comparison_charts"},
        ),
        Analysis(choose_for_study, ChooseSettings, files=("study",)),
        Analysis(
            _of_cubes(speed_accuracy),
            SpeedAccuracySettings,
            sentences="speed_accuracy.sentences:find_in_speed_accuracy",
            table="speed_accuracy.sentences:price_table",
            figures={
                "speed-accuracy": "speed_accuracy.charts:speed_accuracy_charts",
                "models-and-methods": "speed_accuracy.charts:ladder_charts",
                "model-error": "speed_accuracy.charts:model_error_charts",
            },
        ),
        Analysis(
            _of_cubes(check_claims),
            ClaimsSettings,
            partial=True,
            sentences="claims.sentences:find_in_claims",
            table="claims.sentences:claim_table",
            figures={"claims": "claims.charts:claims_charts"},
            export=("claims.json", claims_json),
        ),
        Analysis(
            _of_cubes(claims_over_skew),
            ClaimsOverSkewSettings,
            partial=True,
            sentences="claims.sentences:find_over_skew",
            table="claims.sentences:over_skew_table",
        ),
    )
}
"""Analyses by the kind that study and workflow files use."""

_SEARCHES = {
    "fit": ("fit.sentences:find_in_fit", "fit.sentences:unknown_table"),
    "optimisation": ("optimisation.stored_candidates:findings_in", "optimisation.stored_candidates:candidate_table"),
}
"""Sentences and table of the answers of searches, which no study asks for."""

STUDY_FIGURES = {
    "waveforms": "tripod_doe.page_parts.charts.waveforms:waveform_charts",
    "spectrum": "tripod_doe.page_parts.charts.waveforms:spectrum_chart",
    "effects": "main_effects.charts:all_effect_charts",
    "loci": "tripod_doe.page_parts.charts.needle_locus:locus_chart",
    "waveforms-of-all": "tripod_doe.page_parts.charts.paper_figures:waveforms_of_all",
    "local-orders": "tripod_doe.page_parts.charts.paper_figures:local_order_charts",
    "orders-over-angle": "tripod_doe.page_parts.charts.paper_figures:order_angle_chart",
    "skew": "claims.skew_charts:skew_chart",
    "kept-skew": "claims.skew_charts:kept_skew_charts",
    "findings-over-skew": "claims.skew_charts:findings_over_skew_charts",
    "spectrum-of-all": "tripod_doe.page_parts.charts.paper_figures:spectrum_of_all",
    "friction-law": "tripod_doe.page_parts.charts.paper_figures:friction_law_chart",
    "model-choice": "model_choice.charts:model_choice_chart",
    "outcome-map": "tripod_doe.page_parts.charts.outcomes:outcome_charts",
}
"""Figures of a study by the names that workflow files use: cube -> chart, list of charts, or None."""

FIGURES = (*STUDY_FIGURES, *dict.fromkeys(name for row in ANALYSES.values() for name in row.figures))
"""Names of all figures."""


def _load(place: str) -> Callable[..., Any]:
    """The function at a place of this registry."""
    module, _, name = place.partition(":")
    home = module if module.startswith("tripod_doe.") else f"tripod_doe.analyses.{module}"
    return getattr(import_module(home), name)


def _of_result(place: str, result: xr.Dataset, *words: str) -> Any:
    """What the function at a place makes of the result of an analysis.

    Raises:
        CubeError: If the result, which this process did not make, is not as each of its kind is.
    """
    try:
        return _load(place)(result, *words)
    except (LookupError, TypeError, ValueError, ArithmeticError, AttributeError, RecursionError) as error:
        if kind_of(result) in MADE:  # the error is our own
            raise
        lacks = str(error.args[0]).partition(". ")[0] if error.args else "a name is missing"
        what = f"not a complete result of an analysis of the kind {kind_of(result)!r}"
        raise CubeError(f"{what}: {lacks}; make it again") from error


def findings_of(name: str, data: xr.Dataset) -> list[str]:
    """Findings of a study or an analysis, as sentences.

    Args:
        data: A study's cube or the result of an analysis; one of an unknown kind has no sentences.
    """
    if is_study(data):
        return _load("findings:find")(data)
    row, search = ANALYSES.get(kind_of(data)), _SEARCHES.get(kind_of(data))
    sentences = search[0] if search else row.sentences if row else ""
    return [*answered_range(data, name), *_of_result(sentences, data, name)] if sentences else []


def findings_of_all(results: Mapping[str, xr.Dataset]) -> list[str]:
    """Findings of the analyses of a study, by their names; what several of them say alike is said once."""
    return list(dict.fromkeys(sentence for name, result in results.items() for sentence in findings_of(name, result)))


def table_of(data: xr.Dataset) -> Table | None:
    """The table of an analysis; None if it has none."""
    row, search = ANALYSES.get(kind_of(data)), _SEARCHES.get(kind_of(data))
    table = search[1] if search else row.table if row else ""
    return _of_result(table, data) if table else None


def charts_of(figure: str, results: Mapping[str, xr.Dataset]) -> list[Chart]:
    """The charts of one figure for all analysis results that have it.

    Args:
        results: Results by the names of their analyses.
    """
    return [
        chart
        for name, result in results.items()
        if (row := ANALYSES.get(kind_of(result))) and figure in row.figures
        for chart in _of_result(row.figures[figure], result, name)
    ]


def section_charts(section: str, results: Mapping[str, xr.Dataset]) -> list[Chart]:
    """The charts of a section of a study's page, figure by figure."""
    rows = {name: ANALYSES.get(kind_of(data)) for name, data in results.items()}
    shown = {name: results[name] for name, row in rows.items() if row and row.section == section}
    figures = dict.fromkeys(figure for row in ANALYSES.values() if row.section == section for figure in row.figures)
    return [chart for figure in figures for chart in charts_of(figure, shown)]


def draw(figure: str, inputs: Mapping[str, xr.Dataset]) -> list[Chart]:
    """The charts of a figure step of a workflow.

    Args:
        figure: One of `FIGURES`.
        inputs: Cubes and analysis results by the names of their steps; one cube for a figure of a study.

    Raises:
        InputError: If a figure that shows one input gets several.
    """
    if figure in STUDY_FIGURES:
        (cube,) = inputs.values()
        drawn = _load(STUDY_FIGURES[figure])(cube)
        return drawn if isinstance(drawn, list) else [drawn] if drawn else []
    charts = charts_of(figure, inputs)
    if len({chart.name for chart in charts}) < len(charts):
        raise InputError(f"this figure shows one input, it has {len(inputs)}: {', '.join(inputs)}")
    return charts
