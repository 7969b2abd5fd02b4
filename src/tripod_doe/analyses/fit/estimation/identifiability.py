"""Identifiability of the unknowns: verdicts, correlations, and combinations that are known where a single one is not.

Everything follows from the whitened Jacobian over the unit cube of the unknowns: a singular value s means that its
direction is known to a standard deviation of 1/s of the ranges.
"""

from dataclasses import dataclass

import numpy as np

from tripod_doe.analyses.fit.estimation.profile_likelihood import Profile
from tripod_doe.analyses.fit.estimation.unknowns import Layout
from tripod_doe.array_types import FloatArray

FOUND, ONE_SIDED, NOT_IDENTIFIED, COMBINATION = "found", "one-sided", "not-identified", "combination"
"""Verdicts."""

_KNOWN = 0.25  # of a range: a direction with a shorter half interval is known
_FAR = 10.0  # times the half interval that an unknown would have if all others were known
_PART = 0.02  # of the largest part of a direction, below which an unknown is not named
_LEAST = 1e-6  # singular value over the largest, below which a direction has no information at all


@dataclass(frozen=True)
class Combination:
    """A direction that data determine among unknowns that they do not determine one by one."""

    parts: tuple[tuple[int, float], ...]  # scalars with their factors, in units of the parameters or decades
    value: float  # of the combination
    half: float  # half width of its interval


def covariance_of(jacobian: FloatArray) -> FloatArray:
    """Covariance of the scalars over the unit cube; a direction without information has a large one, not infinity."""
    _, singular, directions = np.linalg.svd(jacobian, full_matrices=False)
    floor = max(_LEAST * float(singular.max(initial=0.0)), 1e-3)
    return np.asarray((directions.T / np.maximum(singular, floor) ** 2) @ directions, float)


def known_variances(jacobian: FloatArray) -> FloatArray:
    """Variances of the scalars in the directions that data determine; in others, nothing that data err by matters."""
    _, singular, directions = np.linalg.svd(jacobian, full_matrices=False)
    known = singular > _LEAST * float(singular.max(initial=0.0))
    parts = (directions[known] / singular[known, None]) ** 2
    return np.asarray(parts.sum(axis=0) + np.finfo(float).tiny, float)


def correlation_of(covariance: FloatArray) -> FloatArray:
    """Correlations of a covariance."""
    deviation = np.sqrt(np.diag(covariance))
    return np.asarray(covariance / np.outer(deviation, deviation), float)


def verdict(profile: Profile, jacobian: FloatArray, allowed: float) -> str:
    """Verdict on one scalar.

    Found where its profile ends on both sides. Where it does not, but would if all other unknowns were known, only a
    combination is known; so it is where only bounds end it, and it is far longer than it would be if all other unknowns
    were known. Else it is bounded on one side, or not identified.

    Args:
        jacobian: Whitened, shape (residual, scalar).
        allowed: Growth of chi squared at the ends of an interval.
    """
    length = float(np.linalg.norm(jacobian[:, profile.scalar]))
    alone = np.sqrt(allowed) / length if length > 0 else np.inf
    far = profile.high - profile.low > 2 * _FAR * alone
    if not (profile.open_low or profile.open_high):
        return COMBINATION if profile.leans and far else FOUND
    if profile.helped or far:
        return COMBINATION
    return NOT_IDENTIFIED if profile.open_low and profile.open_high else ONE_SIDED


def skews_alike(skews: list[float], known: list[bool], either_sign: bool = False) -> list[list[float]]:
    """Other skews of trunnions 1, 2 and 3 that give nearly the same records, where the trunnions are not known apart.

    The trunnions change places in a circle, and what all three have in common hardly counts: it is chosen so that a
    skew that is known stays as it is. Where the sign of the force is not known, the opposite skews are alike, too: a
    force with the opposite sign is one whose third order has turned by 60 deg, and its second order by 60 deg back.

    Args:
        skews, known: Skews of the trunnions, and whether each is known, not fitted; one at most.
        either_sign: Whether the sign of the force is not known.
    """
    opposite = [[-one for one in skews[at:] + skews[:at]] for at in (0, 1, 2)] if either_sign else []
    turned = [skews[at:] + skews[:at] for at in (1, 2)] + opposite
    common = [[new - old for new, old, fixed in zip(each, skews, known, strict=True) if fixed] for each in turned]
    return [[one - sum(shift) for one in each] for each, shift in zip(turned, common, strict=True)]


def combinations(
    layout: Layout, jacobian: FloatArray, places: list[FloatArray], unclear: list[int], allowed: float
) -> list[Combination]:
    """Known directions among the scalars that are not known one by one, the best known first.

    Args:
        jacobian: Whitened, shape (residual, scalar).
        places: The minimum, and others that fit within the interval; a combination reaches over all of them.
        unclear: The scalars whose verdict is a combination.
        allowed: Growth of chi squared at the ends of an interval.
    """
    if len(unclear) < 2:
        return []
    others = [scalar for scalar in range(layout.count) if scalar not in unclear]
    part = jacobian[:, unclear]
    if others:  # what the known ones can make up for says nothing
        basis = np.linalg.qr(jacobian[:, others])[0]
        part = part - basis @ (basis.T @ part)
    _, singular, directions = np.linalg.svd(part, full_matrices=False)
    known = []
    for strength, direction in zip(singular, directions, strict=True):
        if strength <= 0:
            continue
        along = [float(direction @ place[unclear]) for place in places]
        half = float(np.sqrt(allowed) / strength) + (max(along) - min(along)) / 2
        if half <= _KNOWN:
            shift = (max(along) + min(along)) / 2 - along[0]
            known.append(_combination(layout, places[0][unclear] + shift * direction, unclear, direction, half))
    return [each for each in known if len(each.parts) > 1]


def _combination(
    layout: Layout, place: FloatArray, scalars: list[int], direction: FloatArray, half: float
) -> Combination:
    """A direction of places as a sum of values, or of their logarithms; the main part has the factor 1.

    Args:
        place: Place of the scalars, in the middle of the interval of the combination.
    """
    lengths, values = [], []
    for at, scalar in enumerate(scalars):
        unknown = layout.unknowns[layout.owner[scalar]]
        ends = np.array([unknown.low, unknown.high])
        ends = np.log10(ends) if unknown.log else ends
        lengths.append(float(ends[1] - ends[0]))
        values.append(float(ends[0] + (ends[1] - ends[0]) * place[at]))
    factors, main = direction / np.array(lengths), int(np.argmax(np.abs(direction)))
    largest = float(factors[main])
    factors = factors / largest
    kept = [at for at in range(len(scalars)) if abs(direction[at]) >= _PART * abs(direction[main])]
    value = float(sum(factors[at] * values[at] for at in kept))
    return Combination(tuple((scalars[at], float(factors[at])) for at in kept), value, abs(half / largest))
