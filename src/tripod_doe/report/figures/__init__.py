"""Figures: functions from a cube or an analysis to charts, in one style, each with its numbers."""

from tripod_doe.report.figures.chart import Chart
from tripod_doe.report.figures.contributions import contribution_charts
from tripod_doe.report.figures.effects import effect_charts
from tripod_doe.report.figures.factorial_effects import factorial_effect_charts
from tripod_doe.report.figures.failing_region import failing_region_chart
from tripod_doe.report.figures.indices import index_charts
from tripod_doe.report.figures.loci import locus_chart
from tripod_doe.report.figures.model_choice import model_choice_chart
from tripod_doe.report.figures.multifidelity import multifidelity_charts
from tripod_doe.report.figures.skews import findings_over_skew_charts, kept_skew_charts
from tripod_doe.report.figures.stability import stability_charts
from tripod_doe.report.figures.surrogate import surrogate_charts
from tripod_doe.report.figures.tolerance import tolerance_charts
from tripod_doe.report.figures.waveforms import spectrum_chart, waveform_charts

__all__ = [
    "Chart",
    "contribution_charts",
    "effect_charts",
    "factorial_effect_charts",
    "failing_region_chart",
    "findings_over_skew_charts",
    "index_charts",
    "kept_skew_charts",
    "locus_chart",
    "model_choice_chart",
    "multifidelity_charts",
    "spectrum_chart",
    "stability_charts",
    "surrogate_charts",
    "tolerance_charts",
    "waveform_charts",
]
