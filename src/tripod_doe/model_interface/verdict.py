"""Trust in the result of a point: sure, usable or doubtful, with the reason.

The one rule for pages, terminals, cubes and sentences. It judges a model by its known errors at similar points and by
the range in which it holds, and a run by its own numerical error.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from tripod_doe.array_types import FloatArray, IntArray
from tripod_doe.model_interface.known_error import NOTABLE_ERROR, ModelErrors
from tripod_doe.model_interface.outcome import Flag
from tripod_doe.number_text import count_of, duration

LARGE_ERROR = 0.2
"""Relative error of a model; if one of ten similar points has more, the result is doubtful."""


class Trust(Flag):
    """Trust in a result; the integer is the CF flag value."""

    NOT_KNOWN = -1
    """The point failed."""
    SURE = 0
    """Nine in ten similar points are within `NOTABLE_ERROR`."""
    USABLE = 1
    """Similar points are mostly within `NOTABLE_ERROR`, and nine in ten within `LARGE_ERROR`; or one is unsettled."""
    DOUBTFUL = 2
    """Neither, or the error is not known, or the model does not hold there."""


TRUST_ATTRIBUTES = Trust.attributes("how far the third order can be trusted")
"""CF flags of the variable ``trust``."""

_OWN_REASONS = 8  # number of fixed reasons; later ones are those of the errors, and of ranges that points leave
_NOTABLE, _LARGE = f"{100 * NOTABLE_ERROR:g} %", f"{100 * LARGE_ERROR:g} %"


@dataclass(frozen=True)
class Verdicts:
    """Trust in each of some points."""

    trust: NDArray[np.int8]  # a `Trust` per point, shape (point,)
    reason: IntArray  # place of its reason in `reasons`, shape (point,)
    reasons: list[str]


def verdicts(errors: ModelErrors, numerical: FloatArray | None = None) -> Verdicts:
    """Judge results by the errors known for them.

    Args:
        errors: Errors of the models, and the ranges that points leave.
        numerical: Relative numerical error of the same quantity that each run reports, shape (point,); NaN or None if
            unknown.
    """
    what, finest = errors.quantity, errors.reference
    reasons = [
        f"model {finest} is the finest one",
        f"nine in ten similar points were within {_NOTABLE} of model {finest}",
        f"one in ten similar points was off by more than {_NOTABLE}",
        f"one in ten similar points was off by more than {_LARGE}",
        f"half of the similar points were off by more than {_NOTABLE}",
        "the error of its model is not known there",
        f"the run reports a numerical error of the {what} above {_NOTABLE}",
        "its value is known exactly",
    ]
    trust = np.full(errors.expected.size, Trust.DOUBTFUL, np.int8)
    reason = np.full(trust.size, 5)
    known = np.isfinite(errors.expected)
    for code, level, chosen in (
        (4, Trust.DOUBTFUL, known),
        (3, Trust.DOUBTFUL, known & (errors.expected <= NOTABLE_ERROR)),
        (2, Trust.USABLE, known & (errors.expected <= NOTABLE_ERROR) & (errors.limit <= LARGE_ERROR)),
        (1, Trust.SURE, known & (errors.limit <= NOTABLE_ERROR)),
        (7, Trust.SURE, known & (errors.limit == 0)),
        (0, Trust.SURE, errors.models == finest),
    ):
        trust[chosen], reason[chosen] = level, code
    for text in errors.stated:
        reasons.append(text)
        reason[(errors.unknown == text) & (reason == 5)] = len(reasons) - 1
    worst = np.zeros(trust.size)
    for departure in errors.departures:
        reasons.append(departure.reason)
        excess = np.zeros(trust.size)
        excess[departure.outside] = departure.excess
        chosen = (excess > worst) & ((reason < _OWN_REASONS) | (worst > 0))
        trust[chosen], reason[chosen], worst[chosen] = Trust.DOUBTFUL, len(reasons) - 1, excess[chosen]
    if numerical is not None:
        inexact = np.nan_to_num(numerical) > NOTABLE_ERROR
        trust[inexact], reason[inexact] = Trust.DOUBTFUL, 6
    if errors.unsettled is not None:
        chosen = errors.unsettled & (trust == Trust.SURE)
        reasons.append(errors.why_unsettled)
        trust[chosen], reason[chosen] = Trust.USABLE, len(reasons) - 1
    return Verdicts(trust, reason, reasons)


@dataclass
class VerdictCount:
    """Counts of verdicts, in constant memory, and the sentence that states them."""

    quantity: str = ""
    finest: str = ""
    counts: Counter[tuple[Trust, str]] = field(default_factory=Counter)
    checks: Counter[str] = field(default_factory=Counter)  # doubtful points by the cheapest model that is sure there
    unchecked: bool = False  # whether at some points no model is
    prices: dict[str, float] = field(default_factory=dict)  # usual CPU seconds of a point by these models
    unpriced: Collection[str] = ()  # reasons that make a point more expensive than usual ones
    remedies: dict[str, str] = field(default_factory=dict)  # what to change, by the reason that no other model cures

    def add(self, errors: ModelErrors, numerical: FloatArray | None = None) -> NDArray[np.int8]:
        """Judge some points, count them, and return the `Trust` of each."""
        judged = verdicts(errors, numerical)
        self.quantity, self.finest, self.unpriced = errors.quantity, errors.reference, errors.stated
        self.remedies |= {left.reason: left.left.remedy for left in errors.departures if left.left.remedy}
        pairs, counts = np.unique(np.stack([judged.trust, judged.reason]), axis=1, return_counts=True)
        for (trust, reason), count in zip(pairs.T.tolist(), counts.tolist(), strict=True):
            self.counts[Trust(trust), judged.reasons[reason]] += count
        return judged.trust

    def points_by(self, reason: str) -> int:
        """Number of doubtful points with this main reason."""
        return self.counts[Trust.DOUBTFUL, reason]

    def sentences(self, which: str = "") -> list[str]:
        """The verdict as one sentence with its main reason; none without points.

        Args:
            which: A phrase for the points, as `` with all mechanisms on``.
        """
        total = sum(self.counts.values())
        if not total:
            return []
        of_trust: Counter[Trust] = Counter()
        for (trust, _), count in self.counts.items():
            of_trust[trust] += count
        worst, why = self._reasons()
        reason, count = why.most_common(1)[0]
        since = f"mostly since {reason} ({count_of(count, 'point')})" if len(why) > 1 else f"since {reason}"
        if worst is Trust.DOUBTFUL and (advice := self.remedies.get(reason) or self._check(reason, why.total())):
            since += f"; {advice}"
        if len(of_trust) > 1:
            parts = ", ".join(f"{trust.label} at {of_trust[trust]:,}" for trust in sorted(of_trust))
            since = since.removeprefix("mostly ")
            return [f"Verdict on the {self.quantity}: {parts} of {total:,} points{which}; {worst.label} {since}."]
        at = "" if total == 1 else f" at all {total:,} points{which}"
        return [f"Verdict on the {self.quantity}: {worst.label}{at}, {since}."]

    @property
    def main_reason(self) -> str:
        """The reason that the sentence names; empty without points."""
        return self._reasons()[1].most_common(1)[0][0] if self.counts else ""

    def _reasons(self) -> tuple[Trust, Counter[str]]:
        """The lowest trust, and its reasons with their points."""
        worst = max(trust for trust, _ in self.counts)
        return worst, Counter({reason: count for (trust, reason), count in self.counts.items() if trust is worst})

    def _check(self, reason: str, doubtful: int) -> str:
        """What to check doubtful points with: the cheapest model that is sure at most of them, else the finest one.

        Empty where no model is sure.
        """
        if self.unchecked and not self.checks:
            return ""
        model, count = (self.checks or Counter({self.finest: 0})).most_common(1)[0]
        at = "there" if doubtful == 1 else "at all of them" if count == doubtful else f"at {count:,} of them"
        notes = [f"sure {at}"] * bool(count)
        if count and model in self.prices and reason not in self.unpriced:
            notes.append(f"typically {duration(self.prices[model], 2)} of CPU time{' each' * (doubtful > 1)}")
        named = f' with model = "{model}"' + (f" ({', '.join(notes)})" if notes else "")
        return f"check {'it' if doubtful == 1 else 'some of these'}{named}"
