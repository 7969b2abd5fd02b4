"""Measures of claims about orders of the thrust force: each a number from the evidence, with its error."""

import math

import numpy as np

from tripod_doe.analyses.claims.amplitudes import fit_line, line_over, pairs_text, point_of, ratio, spread_of
from tripod_doe.analyses.claims.cases import Cases
from tripod_doe.analyses.claims.evidence import Evidence, Measured, MissingPointError, Point
from tripod_doe.number_text import number


def third_dominates(evidence: Evidence, cases: Cases) -> Measured:
    """Next largest order over the third, the larger of cases 1 and 2."""
    candidates = []
    for case in (1, 2):
        point = point_of(evidence, cases, case)
        sizes = point.output("thrust_amplitude").values.copy()
        sizes[3] = 0
        other = int(np.argmax(sizes))
        third = point.amplitude(3).value
        note = f"Next largest is order {other}: {number(sizes[other])} N, the third {number(third, 4)} N (case {case})."
        candidates.append(ratio(point.amplitude(other), point.amplitude(3), note=note))
    return max(candidates, key=lambda ratio: ratio.value)


def over_torque(evidence: Evidence, cases: Cases) -> Measured:
    """Spread of the third order over torque."""
    torques, amplitudes = line_over(evidence, cases, 2, "torque_n_m", 3)
    return spread_of(amplitudes, np.abs(torques), pairs_text(torques, amplitudes, " N m"))


def over_speed(evidence: Evidence, cases: Cases) -> Measured:
    """Spread of the third order over speeds."""
    speeds, amplitudes = line_over(evidence, cases, 2, "speed_rpm", 3)
    return spread_of(amplitudes, note=pairs_text(speeds, amplitudes, " rpm"))


def straight_over_angle(evidence: Evidence, cases: Cases) -> Measured:
    """R^2 of the line of the third order over the joint angle, the smaller of cases 1 and 2."""
    candidates = []
    for case in (1, 2):
        angles, amplitudes = line_over(evidence, cases, case, "joint_angle_deg", 3)
        slope, offset, straight = fit_line(angles, amplitudes)
        sign = "plus" if offset >= 0 else "minus"
        note = f"Case {case}: {number(slope)} N/deg times the joint angle {sign} {number(abs(offset))} N."
        candidates.append(Measured(straight, math.nan, f"{note} {pairs_text(angles, amplitudes, ' deg')}"))
    return min(candidates, key=lambda fit: fit.value)


def offset_over_angle(evidence: Evidence, cases: Cases) -> Measured:
    """Offset of the line of the third order over its value at 10 deg, in percent."""
    angles, amplitudes = line_over(evidence, cases, 2, "joint_angle_deg", 3)
    slope, offset, _ = fit_line(angles, amplitudes)
    at_ten = slope * 10 + offset
    error = max(a.error for a in amplitudes)
    return Measured(100 * abs(offset) / at_ten, 100 * error / at_ten, f"The offset is {offset:+.3g} N.")


def same_third(evidence: Evidence, cases: Cases) -> Measured:
    """Spread of the third order over the cases."""
    amplitudes = [point_of(evidence, cases, case).amplitude(3) for case in (1, 2, 3, 4)]
    return spread_of(amplitudes, note=f"Cases 1 to 4: {', '.join(number(a.value, 4) for a in amplitudes)} N.")


def same_third_over_angle(evidence: Evidence, cases: Cases) -> Measured:
    """Largest spread of the third order of cases 1 and 2 at a joint angle."""
    angles, first = line_over(evidence, cases, 1, "joint_angle_deg", 3)
    others, second = line_over(evidence, cases, 2, "joint_angle_deg", 3)
    if not np.array_equal(angles, others):
        raise MissingPointError("cases 1 and 2 were run at different angles")
    return max((spread_of([a, b]) for a, b in zip(first, second, strict=True)), key=lambda spread: spread.value)


def with_groove_friction(evidence: Evidence, cases: Cases) -> Measured:
    """R^2 of the line of the third order over the coefficient of groove sliding."""
    frictions, amplitudes = line_over(evidence, cases, 2, "groove_sliding_friction", 3)
    straight = fit_line(frictions, amplitudes)
    return Measured(straight[2], note=pairs_text(frictions, amplitudes, ""))


def beat(evidence: Evidence, cases: Cases) -> Measured:
    """Second over third order of case 2, in percent."""
    point = point_of(evidence, cases, 2)
    return ratio(point.amplitude(2), point.amplitude(3), 100, f"Second order: {number(point.amplitude(2).value)} N.")


def second_above_fourth(evidence: Evidence, cases: Cases) -> Measured:
    """Fourth over second order of case 2."""
    point = point_of(evidence, cases, 2)
    return ratio(point.amplitude(4), point.amplitude(2))


def with_skew(evidence: Evidence, cases: Cases) -> Measured:
    """Ratio of the second orders of cases 2 and 1 over the ratio of their skews."""
    first, second = (point_of(evidence, cases, case).amplitude(2) for case in (1, 2))
    skews = cases.large / cases.small
    return ratio(second, first, 1 / skews, f"{number(first.value)} N in case 1, {number(second.value)} N in case 2.")


def skews_at_end(point: Point) -> str:
    """Mean skews of the last revolution in words, where the cube keeps them."""
    if "needle_skew_summary_deg" not in point.data:
        return ""
    skews = point.output("needle_skew_summary_deg").isel(cycle=-1).sel(statistic="mean").values
    return f"Mean skews in the last revolution: {', '.join(f'{skew:.2f}' for skew in skews)} deg."


def without_skew(evidence: Evidence, cases: Cases) -> Measured:
    """Second order without skew over the second order of case 2, in percent."""
    none = point_of(evidence, cases, 0)
    return ratio(none.amplitude(2), point_of(evidence, cases, 2).amplitude(2), 100, skews_at_end(none))


def second_over_angle(evidence: Evidence, cases: Cases) -> Measured:
    """Spread of the second order over the joint angle, the larger of cases 1 and 2."""
    candidates = []
    for case in (1, 2):
        angles, amplitudes = line_over(evidence, cases, case, "joint_angle_deg", 2)
        candidates.append(spread_of(amplitudes, note=f"Case {case}. {pairs_text(angles, amplitudes, ' deg')}"))
    return max(candidates, key=lambda spread: spread.value)


def equal_skews(evidence: Evidence, cases: Cases) -> Measured:
    """Second order with equal skews over the second order of case 2, in percent."""
    equal = point_of(evidence, cases, 3)
    left, uneven = equal.amplitude(2), point_of(evidence, cases, 2).amplitude(2)
    note = f"Second order: {number(left.value)} N in case 3, {number(uneven.value)} N in case 2. {skews_at_end(equal)}"
    return ratio(left, uneven, 100, note.strip())


def turned_beat(evidence: Evidence, cases: Cases) -> Measured:
    """Phase of the second order against the third, by which the beat is seen, between cases 2 and 4."""
    points = [point_of(evidence, cases, case) for case in (2, 4)]
    phases = [point.phase_deg(3) - point.phase_deg(2) for point in points]
    error = math.hypot(*(min(point.amplitude(2).error / point.amplitude(2).value, 1.0) for point in points))
    return Measured((phases[1] - phases[0]) % 360, math.degrees(error))


def regular_phases(evidence: Evidence, cases: Cases) -> Measured:
    """Largest deviation of the second order's steps of phase from those of equal grooves, each 120 deg ahead."""
    local = point_of(evidence, cases, 3).at_grooves(2)
    if not np.abs(local).min() > 0:
        raise MissingPointError("a local second order is zero and has no phase")
    steps = np.degrees(np.angle(np.roll(local, -1) * local.conj() * np.exp(-2j * np.radians(120))))
    return Measured(float(np.abs(steps).max()), note=f"Local second orders of {number(float(np.abs(local).mean()))} N.")


def local_first(evidence: Evidence, cases: Cases) -> Measured:
    """First order of the sum over the mean of the grooves, in percent."""
    point = point_of(evidence, cases, 2)
    local = float(np.abs(point.at_grooves(1)).mean())
    return ratio(point.amplitude(1), Measured(local, 0.0), 100, f"Mean of the grooves: {number(local)} N.")


def three_local(evidence: Evidence, cases: Cases) -> Measured:
    """Third order of the sum over the mean of the grooves."""
    point = point_of(evidence, cases, 2)
    return ratio(point.amplitude(3), Measured(float(np.abs(point.at_grooves(3)).mean()), 0.0))


def local_orders(evidence: Evidence, cases: Cases) -> Measured:
    """Largest other order at a groove over the smallest of the first three."""
    point = point_of(evidence, cases, 2)
    size = {order: float(np.abs(point.at_grooves(order)).mean()) for order in range(1, 13)}
    others = max(size[order] for order in range(4, 13))
    ranked = sorted(size, key=lambda order: -size[order])
    text = ", ".join(f"order {order} {number(size[order])} N" for order in ranked[: max(5, ranked.index(2) + 1)])
    return Measured(others / min(size[order] for order in (1, 2, 3)), note=f"Means of the grooves: {text}.")


def needle_sliding(evidence: Evidence, cases: Cases) -> Measured:
    """Second order of case 2 without needle sliding over the second order with it, in percent."""
    off = point_of(evidence, cases, 2, needle_sliding=0).amplitude(2)
    whole = point_of(evidence, cases, 2).amplitude(2)
    return ratio(off, whole, 100, f"{number(off.value)} N without needle sliding, {number(whole.value)} N with it.")
