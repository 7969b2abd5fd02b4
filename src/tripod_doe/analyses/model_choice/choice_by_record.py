"""Choice of the model by errors on record, which a short pilot confirms.

A simulator may have on record, from comparisons made once and for all, what its models miss at points like a given one
(`Simulator.recorded_errors`). Then every point takes the cheapest candidate that is within the accuracy at as many of
the similar points as the study asks for, else the one that is within it most often; where that is not even half of
them, the full model.

The pilot checks whether the record holds for this study. It grows from the middle of the design to its farthest points;
each of its points counts like one similar point on record, but those at which the full model does not know itself to
the accuracy, which do not count. The share of all points that will be within the accuracy is expected by the rule of
succession, (within + 1) / (known + 2), of both together: so a miss must be outweighed by further points. Where the
share that the study asks for is out of reach, or the pilot would be as large as one that needs no record, the record
does not count.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from tripod_doe.analyses.model_choice.pilot_errors import HOPELESS, PilotErrors
from tripod_doe.analyses.model_choice.selection import labelled
from tripod_doe.array_types import FloatArray, IntArray
from tripod_doe.model_interface import Candidate
from tripod_doe.study.definition.study import Study
from tripod_doe.study.designs import Points
from tripod_doe.study.result_directory.stored_choice import auto_model_of

CONFIRMING = 4
"""Points of the smallest pilot that confirms a record: it would be confirmed by a chance of 6 % if every other point
missed the accuracy."""


@dataclass(frozen=True)
class RecordedChoice:
    """The model of each point by the errors on record."""

    candidates: tuple[Candidate, ...]  # all candidates, as the study's accuracy has them
    number: IntArray  # number of each point's candidate among them, shape (point,)
    cheap: NDArray[np.bool_]  # whether it is chosen by its recorded errors, not as the full model, shape (point,)
    # share of the similar points at which its error is within the allowed one, shape (point,); 1 with the full model
    share: FloatArray
    # root mean square of its errors at the similar points, over the allowed one, shape (point, quantity); NaN with the
    # full model
    error: FloatArray
    similar: int  # number of similar points that each one is compared with

    @property
    def chosen(self) -> list[Candidate]:
        """The candidates that are chosen by their recorded errors."""
        return [self.candidates[number] for number in np.unique(self.number[self.cheap])]

    def among(self, ran: Collection[Candidate]) -> "RecordedChoice":
        """The choice with the full model in place of cheap candidates that a pilot did not run, as none confirms them.

        So it is where a study grew into a region where another candidate is the cheapest one.
        """
        known = np.array([candidate in ran for candidate in self.candidates])
        cheap = self.cheap & known[self.number]
        error = np.where(cheap[:, None], self.error, np.nan)
        return replace(self, cheap=cheap, share=np.where(cheap, self.share, 1.0), error=error)

    def expected(self, hits: int, known: int) -> float:
        """Share of all points that will be within the accuracy, after a pilot with `hits` at `known` points."""
        recorded = self.similar * float(self.share[self.cheap].mean())
        share = (recorded + hits + 1) / (self.similar + known + 2)
        return float(1 - self.cheap.mean() * (1 - share))

    def hits(self, measured: PilotErrors, at: IntArray) -> tuple[int, int]:
        """At how many pilot points the cheap candidate is within the accuracy, of those at which that is known.

        Args:
            at: Positions of its points among those of the study.
        """
        column = np.array(
            [
                measured.candidates.index(self.candidates[number]) if cheap else -1
                for number, cheap in zip(self.number[at], self.cheap[at], strict=True)
            ]
        )
        rows = np.flatnonzero((column >= 0) & measured.known)
        return int(measured.accepted[rows, column[rows]].sum()), rows.size

    def labelled(
        self, measured: PilotErrors, columns: Mapping[str, NDArray[Any]], study: Study, share: float
    ) -> xr.Dataset:
        """The choice, as `selection.choose` gives it.

        Args:
            columns: Factors of the points, each of shape (point,).
            share: Share of the points expected to be within the accuracy.
        """
        full = [at for at, candidate in enumerate(measured.candidates) if candidate.full]
        usual = next((at for at in full[::-1] if 2 * measured.runs[at] >= measured.count), full[0])
        numbers = np.array(
            [
                measured.candidates.index(self.candidates[number]) if cheap else usual
                for number, cheap in zip(self.number, self.cheap, strict=True)
            ]
        )
        error = np.where(self.cheap[:, None], self.error, measured.numerical.max(axis=0))
        # by the share that `expected` averages, not by `error`: a mean square that one similar point may decide
        auto = auto_model_of(study)
        met = np.where(self.cheap, self.share >= auto.confidence, (error <= 1).all(axis=1))
        return labelled(measured, columns, auto, numbers, error, met).assign_attrs(
            {
                "limit": 1.0,
                "misses": 0,
                "recorded_share": share,
                "price_study_s": float(measured.prices[numbers].sum()),
                "price_pilot_s": measured.price,
                "price_reference_s": float(measured.prices[-1] * numbers.size),
            }
        )


def choice_by_record(study: Study, points: Points) -> RecordedChoice | None:
    """The candidates that recorded errors suggest for the points that may run; None where none are on record.

    None, too, where no point would run with a cheaper model than the full one.
    """
    auto, rows = auto_model_of(study), np.flatnonzero(points.allowed)
    full = next((at for at, candidate in enumerate(auto.candidates) if candidate.full), None)
    if not full:
        return None
    given = points.at(rows)
    shares, errors, similar = [], [], 0
    for candidate in auto.candidates[:full]:
        columns = dict(study.simulator.columns(study.base, given, rows.size))
        for name, value in candidate.values.items():
            columns[name] = np.full(rows.size, value, object if isinstance(value, str) else float)
        recorded = study.simulator.recorded_errors(columns, auto.accuracy)
        if recorded is None:
            return None
        recorded, similar = np.nan_to_num(recorded, nan=HOPELESS, posinf=HOPELESS), recorded.shape[1]
        shares.append((recorded.max(axis=2) <= 1).mean(axis=1))
        errors.append(np.sqrt(np.square(recorded).mean(axis=1)))
    share, every = np.stack(shares, axis=1), np.arange(rows.size)
    enough = share >= auto.confidence
    number = np.where(enough.any(axis=1), enough.argmax(axis=1), share.argmax(axis=1))
    cheap = share[every, number] >= 0.5
    if not cheap.any():
        return None
    error = np.where(cheap[:, None], np.stack(errors, axis=1)[every, number], np.nan)
    return RecordedChoice(
        auto.candidates,
        np.where(cheap, number, full),
        cheap,
        np.where(cheap, share[every, number], 1.0),
        error,
        similar,
    )
