"""All analyses: one row each, with its function and settings and with what a report shows of its result.

To add an analysis, write its function, decorated with `makes_kind`, and a model of its settings, and add a row here.
Sentences, table and figures are optional; studies, workflows, pages and schemas find them in the row.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import wraps
from pathlib import Path
from typing import Any

import xarray as xr
from pydantic import BaseModel

from tripod_doe.analyses.claims.charts import claims_chart
from tripod_doe.analyses.claims.over_skew import ClaimsOverSkewSettings, claims_over_skew
from tripod_doe.analyses.claims.over_skew_sentences import find_over_skew, over_skew_table
from tripod_doe.analyses.claims.sentences import claim_table, find_in_claims
from tripod_doe.analyses.claims.verdicts import ClaimsSettings, check_claims, claims_json
from tripod_doe.analyses.comparison.charts import comparison_charts
from tripod_doe.analyses.comparison.comparison import ComparisonSettings, compare_file
from tripod_doe.analyses.comparison.sentences import find_in_comparison
from tripod_doe.analyses.contribution.charts import contribution_figures
from tripod_doe.analyses.contribution.contribution import ContributionSettings, contribution_shares
from tripod_doe.analyses.contribution.sentences import find_in_contribution
from tripod_doe.analyses.factorial_effects.factorial_effects import EFFECT_DESIGNS, EffectsSettings, factorial_effects
from tripod_doe.analyses.factorial_effects.sentences import effect_table, find_in_effects
from tripod_doe.analyses.findings import find
from tripod_doe.analyses.kinds import is_study, kind_made_by, kind_of
from tripod_doe.analyses.model_choice.selection import ChooseSettings, choose_for_study
from tripod_doe.analyses.multifidelity.charts import multifidelity_charts
from tripod_doe.analyses.multifidelity.multifidelity import MultifidelitySettings, multifidelity
from tripod_doe.analyses.multifidelity.sentences import find_in_multifidelity, model_table
from tripod_doe.analyses.sensitivity import (
    SAMPLED_DESIGNS,
    DeltaSettings,
    DgsmSettings,
    FastSettings,
    MorrisSettings,
    PawnSettings,
    RbdFastSettings,
    ShapleySettings,
    SobolSettings,
    borgonovo_delta,
    derivative_measures,
    fast_indices,
    morris_effects,
    pawn_indices,
    rbd_fast_indices,
    shapley_effects,
    sobol_indices,
)
from tripod_doe.analyses.sensitivity.charts import indices_of_study
from tripod_doe.analyses.sensitivity.sentences import find_in_sensitivity
from tripod_doe.analyses.speed_accuracy.charts import model_error_charts, speed_accuracy_charts
from tripod_doe.analyses.speed_accuracy.sentences import find_in_speed_accuracy, price_table
from tripod_doe.analyses.speed_accuracy.speed_accuracy import SpeedAccuracySettings, speed_accuracy
from tripod_doe.analyses.stability.charts import stability_charts
from tripod_doe.analyses.stability.sentences import find_in_stability, stability_table
from tripod_doe.analyses.stability.stability import StabilitySettings, stability_borders
from tripod_doe.analyses.surrogate.charts import surrogate_charts
from tripod_doe.analyses.surrogate.sentences import find_in_surrogate
from tripod_doe.analyses.surrogate.surrogate import SURROGATE_DESIGNS, SurrogateSettings, surrogate
from tripod_doe.analyses.tolerance.charts import tolerance_charts
from tripod_doe.analyses.tolerance.sentences import find_in_tolerance, tolerance_table
from tripod_doe.analyses.tolerance.tolerance import ToleranceSettings, tolerance
from tripod_doe.report.charts.inputs import Figure, of_one

Table = tuple[list[str], list[list[str]]]
"""Heads and rows."""

Function = Callable[[Mapping[str, xr.Dataset], Any, Path], xr.Dataset]
"""(cubes by the names of their steps, settings, folder of the workflow file) -> result."""


def _of_cube(function: Callable[[xr.Dataset, Any], xr.Dataset]) -> Function:
    """An analysis of the only cube among its inputs."""

    @wraps(function)
    def analysis(cubes: Mapping[str, xr.Dataset], settings: Any, folder: Path) -> xr.Dataset:
        (cube,) = cubes.values()
        return function(cube, settings)

    return analysis


def _of_cubes(function: Callable[[Mapping[str, xr.Dataset], Any], xr.Dataset]) -> Function:
    """An analysis that reads no files beside its cubes."""

    @wraps(function)
    def analysis(cubes: Mapping[str, xr.Dataset], settings: Any, folder: Path) -> xr.Dataset:
        return function(cubes, settings)

    return analysis


def _nothing(name: str, result: xr.Dataset) -> list[str]:
    return []


def _without_name(find_in: Callable[[xr.Dataset], list[str]]) -> Callable[[str, xr.Dataset], list[str]]:
    return lambda name, result: find_in(result)


@dataclass(frozen=True)
class Analysis:
    """One kind of analysis."""

    function: Function  # makes the result, whose attribute ``analysis_kind`` is the kind
    settings: type[BaseModel]  # its settings: [analysis.NAME] of a study, [steps.NAME.settings] of a workflow
    # design kinds of the studies whose cube it can read; empty where only a workflow can ask for it
    designs: tuple[str, ...] = ()
    independent: bool = False  # whether the factors of these designs must not be correlated
    crossed: bool = False  # whether such a design may also be a part of a product
    # settings that name files, relative to the workflow file; their contents are part of the step's inputs
    files: tuple[str, ...] = ()
    # whether it can read the cubes of failed studies: it knows which points did not finish, and reports them
    partial: bool = False
    findings: Callable[[str, xr.Dataset], list[str]] = _nothing  # (name of the analysis, result) -> sentences
    table: Callable[[xr.Dataset], Table] | None = None  # result -> table for a page; None for none
    # figures of results by the names that workflow files use
    figures: Mapping[str, Figure] = field(default_factory=dict)
    # for the answer to a workflow's question: a file of the result directory for other programs, and how its text is
    # made. The page of the workflow shows such an answer first.
    export: tuple[str, Callable[[xr.Dataset], str]] | None = None

    @property
    def kind(self) -> str:
        """The name that study and workflow files use."""
        return kind_made_by(self.function)


ANALYSES: dict[str, Analysis] = {
    row.kind: row
    for row in (
        Analysis(
            _of_cube(sobol_indices),
            SobolSettings,
            designs=("saltelli",),
            findings=find_in_sensitivity,
            figures={"indices": indices_of_study},
        ),
        Analysis(_of_cube(morris_effects), MorrisSettings, designs=("morris",), findings=find_in_sensitivity),
        Analysis(_of_cube(fast_indices), FastSettings, designs=("fast",), findings=find_in_sensitivity),
        Analysis(
            _of_cube(rbd_fast_indices),
            RbdFastSettings,
            designs=SAMPLED_DESIGNS,
            independent=True,
            findings=find_in_sensitivity,
        ),
        Analysis(_of_cube(pawn_indices), PawnSettings, designs=SAMPLED_DESIGNS, findings=find_in_sensitivity),
        Analysis(_of_cube(borgonovo_delta), DeltaSettings, designs=SAMPLED_DESIGNS, findings=find_in_sensitivity),
        Analysis(
            _of_cube(derivative_measures), DgsmSettings, designs=("finite-differences",), findings=find_in_sensitivity
        ),
        Analysis(
            _of_cube(shapley_effects),
            ShapleySettings,
            designs=("latin-hypercube", "rbd-fast"),
            findings=find_in_sensitivity,
        ),
        Analysis(
            _of_cube(factorial_effects),
            EffectsSettings,
            designs=EFFECT_DESIGNS,
            findings=find_in_effects,
            table=effect_table,
        ),
        Analysis(
            _of_cube(surrogate),
            SurrogateSettings,
            designs=SURROGATE_DESIGNS,
            findings=find_in_surrogate,
            figures={"surrogate": surrogate_charts},
        ),
        Analysis(
            _of_cube(tolerance),
            ToleranceSettings,
            designs=SAMPLED_DESIGNS,
            findings=find_in_tolerance,
            table=tolerance_table,
            figures={"tolerance": tolerance_charts},
        ),
        Analysis(
            _of_cube(multifidelity),
            MultifidelitySettings,
            designs=("multifidelity",),
            findings=find_in_multifidelity,
            table=model_table,
            figures={"multifidelity": multifidelity_charts},
        ),
        Analysis(
            _of_cube(contribution_shares),
            ContributionSettings,
            designs=("ablation",),
            crossed=True,
            findings=find_in_contribution,
            figures={"contribution": contribution_figures},
        ),
        Analysis(
            _of_cube(stability_borders),
            StabilitySettings,
            designs=("grid", "product"),
            findings=_without_name(find_in_stability),
            table=stability_table,
            figures={"stability-map": of_one(stability_charts)},
        ),
        Analysis(
            compare_file,
            ComparisonSettings,
            files=("measurement",),
            findings=_without_name(find_in_comparison),
            figures={"comparison": of_one(comparison_charts)},
        ),
        Analysis(choose_for_study, ChooseSettings, files=("study",)),
        Analysis(
            _of_cubes(speed_accuracy),
            SpeedAccuracySettings,
            findings=_without_name(find_in_speed_accuracy),
            table=price_table,
            figures={"speed-accuracy": of_one(speed_accuracy_charts), "model-error": of_one(model_error_charts)},
        ),
        Analysis(
            _of_cubes(check_claims),
            ClaimsSettings,
            partial=True,
            findings=_without_name(find_in_claims),
            table=claim_table,
            figures={"claims": of_one(lambda claims: [claims_chart(claims)])},
            export=("claims.json", claims_json),
        ),
        Analysis(
            _of_cubes(claims_over_skew),
            ClaimsOverSkewSettings,
            partial=True,
            findings=_without_name(find_over_skew),
            table=over_skew_table,
        ),
    )
}
"""Analyses by the kind that study and workflow files use."""


def findings_of(name: str, data: xr.Dataset) -> list[str]:
    """Findings of a study or an analysis, as sentences.

    Parameters
    ----------
    name
        Name of the study or the analysis.
    data
        A study's cube or the result of an analysis; one of an unknown kind has no sentences.
    """
    if is_study(data):
        return find(data)
    return ANALYSES[kind_of(data)].findings(name, data) if kind_of(data) in ANALYSES else []


def table_of(data: xr.Dataset) -> Table | None:
    """The table of an analysis, None where it has none."""
    row = ANALYSES.get(kind_of(data))
    return row.table(data) if row and row.table else None
