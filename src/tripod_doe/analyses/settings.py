"""Settings that analyses of many points share."""

from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from tripod_doe.study.definition.study_file_schema import Table

SHARES = [at / 200 for at in range(1, 200)]
"""Probabilities of the quantiles that draw a distribution, besides the requested quantiles."""


def _between_0_and_1(values: list[float]) -> list[float]:
    if not all(0 < value < 1 for value in values):
        raise ValueError("probabilities lie between 0 and 1")
    return sorted(set(values))


Probabilities = Annotated[
    list[float], Field(min_length=1, description="of the quantiles"), AfterValidator(_between_0_and_1)
]
"""Probabilities of the quantiles that an analysis computes, in ascending order and each once."""

MOST_RESAMPLES = 10_000

Precision = Annotated[
    float, Field(gt=0, description="half width of an interval that is narrow enough, over the largest index")
]


class PointSettings(Table):
    """Settings of every analysis of points: outputs, and treatment of failed points."""

    outputs: list[str] = Field([], description="outputs to analyse; all kept ones if omitted")
    holes: Literal["drop", "rest", "refuse"] = Field(
        "drop",
        description="what is done where points failed: drop the blocks that they belong to, answer for the rest of the "
        "region where most failures lie together, or refuse",
    )
    most_dropped: float = Field(0.2, ge=0, lt=1, description="share of the blocks that may be dropped")


class IntervalSettings(PointSettings):
    """Settings of an analysis with intervals."""

    confidence: float = Field(0.95, gt=0, lt=1, description="level of the confidence intervals")


class ResampledSettings(IntervalSettings):
    """Settings of an analysis with intervals by resampling."""

    resamples: int = Field(100, ge=10, le=MOST_RESAMPLES, description="resamples of the confidence intervals")
    seed: int = Field(0, ge=0, description="seed of the resampling")


class SensitivitySettings(ResampledSettings):
    """[analysis.NAME] of a sensitivity analysis."""

    precision: Precision = 0.05
