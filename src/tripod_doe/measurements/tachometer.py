"""Rotation angle from a tachometer: detect its edges, remove bounces, and count missing pulses."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tripod_doe.array_types import FloatArray, IntArray
from tripod_doe.errors import InputError, option
from tripod_doe.measurements.spectrum import cycle_amplitudes, refined_peak
from tripod_doe.number_text import number

_LOW, _HIGH = 0.35, 0.65  # thresholds of an edge within the range of the tachometer: noise between them makes no edge
_OUTLIERS = (0.0, 0.001, 0.01, 0.05)  # parts of the samples, at each end, that may be spikes beyond the range
_MANY = 3  # factor of pulses above which a narrower range is trusted
_NEIGHBOURS = 5  # intervals whose median is the local time between pulses
_BOUNCE = 0.25  # of the time between pulses; a second edge within it is a bounce
_EARLY = 0.04  # of the time between pulses; an edge this early with a bounce after it may be a spike
_WINDOW = 15  # edges around an edge, to estimate the time between pulses among bounces
_RARE = 10  # one edge in this number may be a spike
_LOOSE = 1.5  # times the next interval; a longer first or last interval may hide a pulse
_UNEVEN = 0.3  # largest difference from a whole multiple of the neighbouring intervals
_SHORT = 0.05  # relative; the first or last interval may be this much shorter at constant speed
_RAGGED = 0.15  # largest median difference of intervals from whole multiples
_FEWEST_SAMPLES = 5  # from pulse to pulse, of which fewer are named as the reason why pulses look irregular
_MOST_CUT = 0.5  # part of a record's time that may be cut off at irregular pulses


@dataclass(frozen=True)
class Pulses:
    """Pulses of a tachometer."""

    times: FloatArray  # instants of the edges in s, shape (edge,)
    numbers: IntArray  # pulse numbers of the edges, from 0; missing pulses are counted, shape (edge,)
    extra: int = 0  # edges that were dropped: bounces and spikes

    @property
    def lost(self) -> int:
        """Number of missing pulses."""
        return int(self.numbers[-1]) + 1 - self.numbers.size


def find_pulses(time_s: FloatArray, tacho: FloatArray) -> Pulses:
    """Pulses of a tachometer, repaired.

    An edge closely after another edge is a bounce; an edge between two others that are a whole number of pulses apart
    is a spike. If an interval stays uneven, the longer part of the record on one side of it is kept.

    Args:
        time_s, tacho: Time in s and tachometer in any unit, shape (sample,).

    Raises:
        InputError: If there are fewer than two pulses, or irregular pulses cut off most of the record.
    """
    best, problem = None, InputError("")
    for part in _OUTLIERS:
        edges = edge_times(time_s, tacho, part)
        try:
            if edges.size < 2:
                raise _no_edges(edges.size)
            pulses = mended(edges)
        except InputError as error:
            problem = problem if str(problem) else error
            continue
        if best is None or pulses.times.size > _MANY * best.times.size:
            best = pulses
    if best is None:
        raise _too_fast(time_s, edge_times(time_s, tacho)) or problem
    return best


def _too_fast(time_s: FloatArray, edges: FloatArray) -> InputError | None:
    """Why pulses cannot be distinguished, if the sampling is the reason."""
    if edges.size < 2 or (samples := float(np.median(np.diff(edges)) / np.median(np.diff(time_s)))) >= _FEWEST_SAMPLES:
        return None
    return InputError(
        f"the pulses of tacho are irregular, one about every {number(samples, 2)} samples, too few to see where it "
        f"begins: sample the tachometer at least {_FEWEST_SAMPLES} times as fast as its pulses come, use one with "
        "fewer pulses, or name its column if tacho is none"
    )


def _no_edges(count: int) -> InputError:
    return InputError(
        f"{count or 'no'} rising edge{'s' if count != 1 else ''} in tacho; give a pulse or square wave with at least "
        "one rising edge per revolution, or a column rotation_deg"
    )


def edge_times(time_s: FloatArray, tacho: FloatArray, outliers: float = 0.0) -> FloatArray:
    """Instants in s at which a pulse train or square wave rises through the middle of its range.

    A rise counts when it goes from below 35 % to above 65 % of the range, so that noise up to 15 % makes no edge.

    Args:
        time_s, tacho: Time in s and tachometer in any unit, shape (sample,).
        outliers: Part of the samples at each end that does not count for the range.

    Returns:
        ndarray, shape (edge,)
    """
    low, high = (float(end) for end in np.quantile(tacho, [outliers, 1 - outliers])) if tacho.size else (0.0, 0.0)
    state = np.where(tacho > low + _HIGH * (high - low), 1, 0) - np.where(tacho < low + _LOW * (high - low), 1, 0)
    decided = np.flatnonzero(state)
    rising = np.flatnonzero(np.diff(state[decided]) > 0)
    before, after = decided[rising], decided[rising + 1]
    part = np.clip(((low + high) / 2 - tacho[before]) / (tacho[after] - tacho[before]), 0, 1)
    return np.asarray(time_s[before] + part * (time_s[after] - time_s[before]), float)


def mended(edges: FloatArray) -> Pulses:
    """Pulses from edges: without bounces, spikes and loose ends; missing pulses are counted.

    Args:
        edges: Instants in s, at least two, shape (edge,).

    Raises:
        InputError: If pulses that cannot be repaired cut off most of the record.
    """
    given = edges.size
    edges = _without_spikes(_in_place(_without_bounces(edges), edges))
    extra = given - edges.size
    edges = _without_loose_ends(edges)
    ratio, whole = _ratios(edges)
    uneven = np.flatnonzero(_is_uneven(ratio, whole))
    ragged = float(np.median(np.abs(ratio - whole))) > _RAGGED
    if not uneven.size and not ragged:
        return Pulses(edges, np.concatenate([[0], np.cumsum(whole)]), extra)
    bounds = np.concatenate([[-1], uneven, [edges.size - 1]])
    longest = int(np.argmax(edges[bounds[1:]] - edges[bounds[:-1] + 1]))
    first, last = bounds[longest] + 1, bounds[longest + 1]
    if ragged or edges[last] - edges[first] < (1 - _MOST_CUT) * (edges[-1] - edges[0]):
        at, interval = int(np.argmax(np.abs(ratio - whole))), np.diff(edges)
        raise InputError(
            f"the pulses of tacho are irregular: {interval[at]:.4g} s between those at {edges[at]:.6g} s and "
            f"{edges[at + 1]:.6g} s, where their neighbours are {interval[at] / ratio[at]:.4g} s apart; clean the "
            "tachometer signal or cut the record there"
        )
    return Pulses(edges[first : last + 1], np.concatenate([[0], np.cumsum(whole[first:last])]), extra)


def _without_bounces(edges: FloatArray) -> FloatArray:
    """Edges, except edges that follow another edge within a quarter of the time between pulses.

    Bounces may outnumber pulses. So the time between pulses is the median of neighbouring intervals weighted by their
    lengths: short intervals hardly change it.
    """
    while edges.size > 3:
        interval = np.diff(edges)
        width = min(_WINDOW, interval.size) | 1
        padded = np.pad(interval, width // 2, mode="symmetric" if interval.size > width // 2 else "edge")
        near = np.sort(np.lib.stride_tricks.sliding_window_view(padded, width)[: interval.size], axis=1)
        half = np.cumsum(near, axis=1) >= near.sum(axis=1, keepdims=True) / 2
        usual = np.take_along_axis(near, np.argmax(half, axis=1)[:, None], axis=1)[:, 0]
        short = interval < _BOUNCE * usual
        kept = np.concatenate([[True], ~short])
        if kept.all():
            break
        edges = edges[kept]
    return edges


def _in_place(kept: FloatArray, edges: FloatArray) -> FloatArray:
    """Edges, with a spike closely before a pulse replaced by the pulse."""
    kept = kept.copy()
    for at in range(1, kept.size - 1):
        middle, near = (kept[at - 1] + kept[at + 1]) / 2, _BOUNCE * (kept[at + 1] - kept[at - 1]) / 2
        early = middle - kept[at]
        if _EARLY * near / _BOUNCE < early < near:
            behind = edges[(edges > kept[at]) & (edges < kept[at] + near)]
            if behind.size and (off := np.abs(behind - middle)).min() < early / 2:
                kept[at] = behind[int(np.argmin(off))]
    return kept


def _without_spikes(edges: FloatArray) -> FloatArray:
    """Edges, except an edge in uneven intervals between two others that are a whole number of pulses apart."""
    for _ in range(edges.size // _RARE):
        ratio, whole = _ratios(edges)
        off = np.abs(ratio - whole) + (whole < 1)
        both = ratio[:-1] + ratio[1:]
        joined = np.abs(both - np.rint(both))
        gain = np.where(np.rint(both) >= 1, np.maximum(off[:-1], off[1:]) - joined, -1.0)
        gain[~(_is_uneven(ratio, whole)[:-1] | _is_uneven(ratio, whole)[1:]) | (joined > _UNEVEN)] = -1.0
        if gain.max() <= 0:
            break
        best = int(np.argmax(gain))
        edges = np.delete(edges, best + 1)
    return edges


def _ratios(edges: FloatArray) -> tuple[FloatArray, IntArray]:
    """Intervals divided by the median of their neighbours, and the whole numbers of pulses in them."""
    from scipy.ndimage import median_filter

    interval = np.diff(edges)
    ratio = interval / median_filter(interval, size=_NEIGHBOURS, mode="nearest")
    return ratio, np.rint(ratio).astype(np.int64)


def _is_uneven(ratio: FloatArray, whole: IntArray) -> IntArray:
    return np.asarray((whole < 1) | (np.abs(ratio - whole) > _UNEVEN))


def _without_loose_ends(edges: FloatArray) -> FloatArray:
    """Edges, without a first or last interval that does not match the next intervals.

    At the ends of a record a missing pulse and a start from rest look the same, so neither is counted; and the first
    edge may be the bounce of a pulse before the record.
    """
    while edges.size > 3 and _is_loose(*np.diff(edges[:4])):
        edges = edges[1:]
    while edges.size > 3 and _is_loose(*np.diff(edges[-4:])[::-1]):
        edges = edges[:-1]
    return edges


def _is_loose(end: float, near: float, far: float) -> bool:
    """Whether the interval at an end is much longer than its neighbour, or too short for any change of speed."""
    return end > _LOOSE * near or np.log(near / end) > _SHORT + 3 * abs(np.log(far / near))


def angle_between_pulses(pulses: Pulses, time_s: FloatArray, pulses_per_revolution: int) -> FloatArray:
    """Rotation angle in deg at times between the first and the last pulse, 0 at the first pulse.

    A cubic spline runs through the instants of the edges, 360/n deg apart: constant acceleration is exact, ripple
    between two pulses is invisible. Computed order tracking after Fyfe and Munck,
    Mechanical Systems and Signal Processing 11 (1997) 187-205.

    Raises:
        InputError: If the angle runs backwards, because there are too few pulses for the changes of speed.
    """
    from scipy.interpolate import CubicSpline

    angle: Callable[[FloatArray], FloatArray] = CubicSpline(
        pulses.times, pulses.numbers * (360.0 / pulses_per_revolution)
    )
    rotation = angle(time_s)
    if np.any(np.diff(rotation) < 0):
        raise InputError(
            "the angle between tachometer pulses runs backwards; the record needs more pulses per revolution"
        )
    return rotation


_NEAR = 0.04  # relative: largest distance of a count from a whole number, and of a stated speed from the true speed
_CLEAR = 0.05  # least part of the strongest amplitude for another oscillation to count
_WHOLE = 0.15  # largest distance of a strong oscillation from a whole order


def infer_pulses(pulses: Pulses, time_s: FloatArray, thrust_n: FloatArray, speed_rpm: float | None) -> tuple[int, str]:
    """Pulses per revolution, and a sentence on the origin of the number; empty for a single pulse.

    With a known speed, the pulse rate gives the number: exactly for few pulses, and for many so that the strongest
    oscillation of the force is a whole order. Otherwise this oscillation counts as the third order, or as another
    order if only that explains the other oscillations.
    """
    flag = option("pulses_per_revolution")
    angle = angle_between_pulses(pulses, time_s, 1)
    cycles, amplitude = cycle_amplitudes(angle, thrust_n)
    strongest = refined_peak(angle, thrust_n, cycles, amplitude)
    if speed_rpm:
        exact = 60 * float(pulses.numbers[-1] / (pulses.times[-1] - pulses.times[0])) / speed_rpm
        count = max(round(exact), 1)
        if _NEAR * exact > 0.5 and strongest:  # the speed cannot distinguish neighbouring counts
            by_order = max(round(strongest * exact), 1) / strongest
            count = round(by_order) if abs(by_order / exact - 1) < _NEAR else count
        if abs(exact / count - 1) > _NEAR:
            return count, (
                f"Check the speed or the pulses: {number(speed_rpm)} rpm would be {number(exact)} pulses per "
                f"revolution; {count} are assumed ({flag})."
            )
        said = f"{count} pulses per revolution follow from the speed of {number(speed_rpm)} rpm ({flag})."
        return count, "" if count == 1 else said
    if strongest is None:
        return 1, ""
    count, order = _count_by_force(cycles, amplitude, strongest)
    return count, "" if count == 1 else (
        f"{count} pulses per revolution are assumed, so that the strongest oscillation of the force is its "
        f"{('first', 'second', 'third')[order - 1]} order ({flag})."
    )


def _count_by_force(cycles: FloatArray, amplitude: FloatArray, strongest: float) -> tuple[int, int]:
    """Pulses per revolution with which the strongest oscillation is the third order, else the second or first one.

    With this number all strong, resolved oscillations must be whole orders; otherwise the third order decides.

    Args:
        cycles, amplitude: Cycles per pulse, and amplitudes of the force.
        strongest: Cycles per pulse of the strongest oscillation.
    """
    wide = 2 * float(cycles[1] - cycles[0])
    peaks = cycles[amplitude > _CLEAR * amplitude.max()]
    choices = []
    for order in (3, 2, 1):
        count = max(round(order / strongest), 1)
        if abs(order / strongest / count - 1) > _NEAR:
            continue
        orders = peaks * count
        if np.all(np.abs(orders - np.rint(orders)) <= max(_WHOLE, wide * count)):
            if count == order == 3 and _has(cycles, amplitude, 3.0) and not _has(cycles, amplitude, 1 / 3):
                return 1, 1  # the ninth order would be strong, but only multiples of three occur
            return count, order
        choices.append((count, order))
    return choices[0] if choices else (1, 3)


def _has(cycles: FloatArray, amplitude: FloatArray, at: float) -> bool:
    """Whether the force oscillates at the given cycles per pulse."""
    near = np.abs(cycles - at) < max(_NEAR * at, 2 * float(cycles[1] - cycles[0]))
    return bool(amplitude[near].max(initial=0.0) > _CLEAR * amplitude.max())
