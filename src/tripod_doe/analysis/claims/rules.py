"""What the paper claims, as rules: a number from the cubes, and the limits within which the claim holds."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tripod_doe.analysis.claims import reasons
from tripod_doe.analysis.claims.evidence import ANY, Evidence, Measured, MissingPointError, Point
from tripod_doe.analysis.contribution import PAPER_SHARES, contribution_shares
from tripod_doe.joint.parameters import point_values
from tripod_doe.quantities import level, number
from tripod_doe.study.cube import SWITCH_ROLE

__all__ = ["RULES", "Cases", "Rule"]

FloatArray = NDArray[np.float64]

_PAPER_ANGLES = (4.0, 14.0)
_DEFINITIONS = {"share_off": "switching off", "share_on": "on alone", "share_shapley": "Shapley value"}


@dataclass(frozen=True)
class Cases:
    """The paper's analysis cases for one model; it does not print their skews.

    Attributes
    ----------
    model
        Model of the ladder.
    small, large
        Skews of case 1 and of cases 2 to 4 in degrees.
    """

    model: str
    small: float
    large: float

    @property
    def text(self) -> str:
        """The skews of all cases."""
        told = (f"case {case} ({', '.join(level(skew) for skew in self.skews(case))})" for case in (1, 2, 3, 4))
        return f"{', '.join(told)} deg on trunnions 1, 2, 3; chosen, since the paper does not print them"

    def skews(self, case: int) -> tuple[float, float, float]:
        """Initial skews of a case in degrees: 1 and 2 uneven, 3 equal, 4 as 2 reversed, 0 none."""
        small, large = self.small, self.large
        return {
            0: (0.0, 0.0, 0.0), 1: (small, -small, small), 2: (large, -large, large),
            3: (large, large, large), 4: (-large, large, -large),
        }[case]  # fmt: skip

    def wanted(self, case: int) -> dict[str, Any]:
        """Parameter values that identify the points of a case."""
        skews = {f"initial_skew_{k}_deg": skew for k, skew in enumerate(self.skews(case), 1)}
        return {"model": self.model} | skews


@dataclass(frozen=True)
class Rule:
    """One claim.

    Attributes
    ----------
    name
        Its identifier.
    statement, place
        What the paper says, and where.
    quantity, unit
        The number that decides it.
    low, high
        Limits within which it holds; None for none.
    measure
        The number, from the evidence; raises `MissingPointError` where its points are not there.
    why_not
        The known reason if it does not hold.
    """

    name: str
    statement: str
    place: str
    quantity: str
    unit: str
    low: float | None
    high: float | None
    measure: Callable[[Evidence, Cases], Measured]
    why_not: str = ""


def _point(evidence: Evidence, cases: Cases, case: int, **more: Any) -> Point:
    return evidence.joint(**cases.wanted(case), **more)[0]


def _ratio(above: Measured, below: Measured, scale: float = 1.0, note: str = "") -> Measured:
    """A quotient with its error, those of both taken as independent."""
    if not below.value > 0:
        raise MissingPointError("the value in the denominator is zero")
    error = math.hypot(above.error, above.value / below.value * below.error) / below.value
    return Measured(scale * above.value / below.value, scale * error, note)


def _line(evidence: Evidence, cases: Cases, case: int, factor: str, order: int) -> tuple[FloatArray, list[Measured]]:
    """Values of a factor with at least three levels, sorted, and an order's amplitude there."""
    points = sorted(evidence.joint(**cases.wanted(case), **{factor: ANY}), key=lambda point: float(point.value(factor)))
    if factor == "joint_angle_deg":
        points = [point for point in points if _PAPER_ANGLES[0] <= point.value(factor) <= _PAPER_ANGLES[1]]
    if len(points) < 3:
        raise MissingPointError(f"fewer than three values of {factor} were run")
    return np.array([float(p.value(factor)) for p in points]), [point.amplitude(order) for point in points]


def _told(levels: FloatArray, amplitudes: list[Measured], unit: str) -> str:
    pairs = (f"{number(a.value)} N at {level(value)}{unit}" for value, a in zip(levels, amplitudes, strict=True))
    return f"Values: {', '.join(pairs)}."


def _spread(amplitudes: list[Measured], levels: FloatArray | None = None, note: str = "") -> Measured:
    """Largest deviation from the mean of amplitudes, or of amplitudes over levels, in percent."""
    below = np.ones(len(amplitudes)) if levels is None else levels
    values = np.array([a.value for a in amplitudes]) / below
    errors = np.array([a.error for a in amplitudes]) / below
    return Measured(
        100 * float(np.abs(values / values.mean() - 1).max()), 100 * float(errors.max() / values.mean()), note
    )


def _fit(levels: FloatArray, amplitudes: list[Measured]) -> tuple[float, float, float]:
    """Slope, offset and R^2 of the straight line."""
    values = np.array([a.value for a in amplitudes])
    slope, offset = np.polyfit(levels, values, 1)
    rest = values - slope * levels - offset
    return float(slope), float(offset), 1 - float(rest @ rest / ((values - values.mean()) ** 2).sum())


def _third_dominates(evidence: Evidence, cases: Cases) -> Measured:
    found = []
    for case in (1, 2):
        point = _point(evidence, cases, case)
        sizes = point.output("thrust_amplitude").values.copy()
        sizes[3] = 0
        other = int(np.argmax(sizes))
        third = point.amplitude(3).value
        note = f"Next largest is order {other}: {number(sizes[other])} N, the third {number(third, 4)} N (case {case})."
        found.append(_ratio(point.amplitude(other), point.amplitude(3), note=note))
    return max(found, key=lambda ratio: ratio.value)


def _torque(evidence: Evidence, cases: Cases) -> Measured:
    torques, amplitudes = _line(evidence, cases, 2, "torque_n_m", 3)
    return _spread(amplitudes, torques, _told(torques, amplitudes, " N m"))


def _speed(evidence: Evidence, cases: Cases) -> Measured:
    speeds, amplitudes = _line(evidence, cases, 2, "speed_rpm", 3)
    return _spread(amplitudes, note=_told(speeds, amplitudes, " rpm"))


def _straight(evidence: Evidence, cases: Cases) -> Measured:
    found = []
    for case in (1, 2):
        angles, amplitudes = _line(evidence, cases, case, "joint_angle_deg", 3)
        slope, offset, straight = _fit(angles, amplitudes)
        sign = "plus" if offset >= 0 else "minus"
        note = f"Case {case}: {number(slope)} N/deg times the joint angle {sign} {number(abs(offset))} N."
        found.append(Measured(straight, math.nan, f"{note} {_told(angles, amplitudes, ' deg')}"))
    return min(found, key=lambda fit: fit.value)


def _offset(evidence: Evidence, cases: Cases) -> Measured:
    angles, amplitudes = _line(evidence, cases, 2, "joint_angle_deg", 3)
    slope, offset, _ = _fit(angles, amplitudes)
    at_ten = slope * 10 + offset
    error = max(a.error for a in amplitudes)
    return Measured(100 * abs(offset) / at_ten, 100 * error / at_ten, f"The offset is {offset:+.3g} N.")


def _same_third(evidence: Evidence, cases: Cases) -> Measured:
    amplitudes = [_point(evidence, cases, case).amplitude(3) for case in (1, 2, 3, 4)]
    return _spread(amplitudes, note=f"Cases 1 to 4: {', '.join(number(a.value, 4) for a in amplitudes)} N.")


def _same_third_over_angle(evidence: Evidence, cases: Cases) -> Measured:
    angles, first = _line(evidence, cases, 1, "joint_angle_deg", 3)
    others, second = _line(evidence, cases, 2, "joint_angle_deg", 3)
    if not np.array_equal(angles, others):
        raise MissingPointError("cases 1 and 2 were run at different angles")
    return max((_spread([a, b]) for a, b in zip(first, second, strict=True)), key=lambda spread: spread.value)


def _beat(evidence: Evidence, cases: Cases) -> Measured:
    point = _point(evidence, cases, 2)
    return _ratio(point.amplitude(2), point.amplitude(3), 100, f"Second order: {number(point.amplitude(2).value)} N.")


def _second_above_fourth(evidence: Evidence, cases: Cases) -> Measured:
    point = _point(evidence, cases, 2)
    return _ratio(point.amplitude(4), point.amplitude(2))


def _with_skew(evidence: Evidence, cases: Cases) -> Measured:
    first, second = (_point(evidence, cases, case).amplitude(2) for case in (1, 2))
    skews = cases.large / cases.small
    return _ratio(second, first, 1 / skews, f"{number(first.value)} N in case 1, {number(second.value)} N in case 2.")


def _without_skew(evidence: Evidence, cases: Cases) -> Measured:
    none = _point(evidence, cases, 0)
    return _ratio(none.amplitude(2), _point(evidence, cases, 2).amplitude(2), 100, _skews_at_end(none))


def _skews_at_end(point: Point) -> str:
    """Mean skews of the last revolution in words, where the cube keeps them."""
    if "needle_skew_summary_deg" not in point.data:
        return ""
    skews = point.output("needle_skew_summary_deg").isel(cycle=-1).sel(statistic="mean").values
    return f"Mean skews in the last revolution: {', '.join(f'{skew:.2f}' for skew in skews)} deg."


def _second_over_angle(evidence: Evidence, cases: Cases) -> Measured:
    found = []
    for case in (1, 2):
        angles, amplitudes = _line(evidence, cases, case, "joint_angle_deg", 2)
        found.append(_spread(amplitudes, note=f"Case {case}. {_told(angles, amplitudes, ' deg')}"))
    return max(found, key=lambda spread: spread.value)


def _equal_skews(evidence: Evidence, cases: Cases) -> Measured:
    equal = _point(evidence, cases, 3)
    left, uneven = equal.amplitude(2), _point(evidence, cases, 2).amplitude(2)
    note = f"Second order: {number(left.value)} N in case 3, {number(uneven.value)} N in case 2. {_skews_at_end(equal)}"
    return _ratio(left, uneven, 100, note.strip())


def _turned(evidence: Evidence, cases: Cases) -> Measured:
    """Phase of the second order against the third, by which the beat is seen, between cases 2 and 4."""
    points = [_point(evidence, cases, case) for case in (2, 4)]
    phases = [point.phase_deg(3) - point.phase_deg(2) for point in points]
    error = math.hypot(*(min(point.amplitude(2).error / point.amplitude(2).value, 1.0) for point in points))
    return Measured((phases[1] - phases[0]) % 360, math.degrees(error))


def _regular(evidence: Evidence, cases: Cases) -> Measured:
    """Largest deviation of the second order's steps of phase from those of equal grooves, each 120 deg ahead."""
    local = _point(evidence, cases, 3).at_grooves(2)
    if not np.abs(local).min() > 0:
        raise MissingPointError("a local second order is zero and has no phase")
    steps = np.degrees(np.angle(np.roll(local, -1) * local.conj() * np.exp(-2j * np.radians(120))))
    return Measured(float(np.abs(steps).max()), note=f"Local second orders of {number(float(np.abs(local).mean()))} N.")


def _local_first(evidence: Evidence, cases: Cases) -> Measured:
    point = _point(evidence, cases, 2)
    local = float(np.abs(point.at_grooves(1)).mean())
    return _ratio(point.amplitude(1), Measured(local, 0.0), 100, f"Mean of the grooves: {number(local)} N.")


def _three_local(evidence: Evidence, cases: Cases) -> Measured:
    point = _point(evidence, cases, 2)
    return _ratio(point.amplitude(3), Measured(float(np.abs(point.at_grooves(3)).mean()), 0.0))


def _local_orders(evidence: Evidence, cases: Cases) -> Measured:
    point = _point(evidence, cases, 2)
    size = {order: float(np.abs(point.at_grooves(order)).mean()) for order in range(1, 13)}
    others = max(size[order] for order in range(4, 13))
    ranked = sorted(size, key=lambda order: -size[order])
    told = ", ".join(f"order {order} {number(size[order])} N" for order in ranked[: max(5, ranked.index(2) + 1)])
    return Measured(others / min(size[order] for order in (1, 2, 3)), note=f"Means of the grooves: {told}.")


def _share(mechanism: str) -> Callable[[Evidence, Cases], Measured]:
    """The share by the definition whose value is closest to the paper's."""
    paper = PAPER_SHARES.get(mechanism, 100 - sum(PAPER_SHARES.values()))

    def measure(evidence: Evidence, cases: Cases) -> Measured:
        point = _point(evidence, cases, 2)
        cube = next((cube for cube in evidence.cubes.values() if _ablates(cube, point, cases)), None)
        if cube is None:
            raise MissingPointError(f"no ablation of the mechanisms with model {cases.model} in case 2 was run")
        result = contribution_shares(cube)
        shares = {
            name: float(result[name].sel(mechanism=mechanism, order=3)) for name in _DEFINITIONS if name in result
        }
        known = {name: share for name, share in shares.items() if math.isfinite(share)}
        if not known:
            raise MissingPointError("points of the ablation did not finish")
        nearest = min(known, key=lambda name: abs(known[name] - paper))
        error = 100 * math.sqrt(2) * point.amplitude(3).error / point.amplitude(3).value
        told = ", ".join(f"{_DEFINITIONS[name]} {share:.1f} %" for name, share in shares.items())
        return Measured(known[nearest], error, f"Definition closest to the paper: {_DEFINITIONS[nearest]}; {told}.")

    return measure


def _ablates(cube: Any, point: Point, cases: Cases) -> bool:
    """Whether a cube holds an ablation of this model in case 2, at the reference point."""
    if not any(cube[name].attrs.get("role") == SWITCH_ROLE for name in cube.coords):
        return False
    there = Evidence({"ablation": cube})
    try:
        there.joint(**cases.wanted(2))
    except MissingPointError:
        return False
    return True


def _needle_sliding(evidence: Evidence, cases: Cases) -> Measured:
    off = _point(evidence, cases, 2, needle_sliding=0).amplitude(2)
    whole = _point(evidence, cases, 2).amplitude(2)
    return _ratio(off, whole, 100, f"{number(off.value)} N without needle sliding, {number(whole.value)} N with it.")


def _skew_stays(evidence: Evidence, cases: Cases) -> Measured:
    found = []
    for case in (1, 2):
        summary = _point(evidence, cases, case).output("needle_skew_summary_deg").isel(cycle=-1)
        mean, least, most = (summary.sel(statistic=name).values for name in ("mean", "min", "max"))
        start = np.array(cases.skews(case))
        told = ", ".join(
            f"{level(s)} -> {m:.2f} (range {low:.2f} to {high:.2f})"
            for s, m, low, high in zip(start, mean, least, most, strict=True)
        )
        change = 100 * float(np.abs(mean / start - 1).max())
        found.append(
            Measured(change, note=f"Case {case}, trunnions 1 to 3 in deg: {told}, change at most {change:.0f} %.")
        )
    return Measured(max(each.value for each in found), note=" ".join(each.note for each in found))


def _degrees_of_freedom(evidence: Evidence, cases: Cases) -> Measured:
    """Free velocities of the scene of the reference joint, less its constraints."""
    from tripod_doe.joint.multibody_scene import build_joint
    from tripod_doe.mechanics.assembly import assemble

    tables = assemble(build_joint(point_values({}).point(0), needles=True)).tables
    free = int(tables.bodies["free"][tables.bodies["block"] >= 0].sum())
    return Measured(float(free - tables.rows.size), 0.0, f"{free} velocities minus {tables.rows.size} constraints.")


def _friction_from_rest(evidence: Evidence, cases: Cases) -> Measured:
    """Largest deviation of a tilted roller's axial force from that of mu_s tanh(v/v_st), percent of its full value."""
    points = evidence.scene(tilt_deg=ANY, axial_speed_mm_s=ANY, transition_ratio=ANY)
    velocity = np.array([1 / float(point.value("transition_ratio")) for point in points])
    if velocity.size < 3:
        raise MissingPointError("fewer than three sliding velocities were run")
    full = [float(point.value("friction")) for point in points]
    normal = [float(p.value("load_n")) * math.sin(math.radians(abs(float(p.value("tilt_deg"))))) for p in points]
    felt = np.array([float(point.output("axial_force_n")) for point in points]) / normal / full
    slow, fast = int(velocity.argmin()), int(velocity.argmax())
    note = (
        f"The coefficient is {number(100 * felt[slow])} % of its full value at {level(velocity[slow])} times the "
        f"transition velocity, {number(100 * felt[fast], 4)} % at {level(velocity[fast])} times."
    )
    return Measured(100 * float(np.abs(felt - np.tanh(velocity)).max()), note=note)


def _loci(evidence: Evidence) -> dict[str, tuple[float, float]]:
    """Drift and travel in mm by which plate has more friction."""
    found = {}
    for point in evidence.scene(friction_a=ANY, friction_b=ANY):
        a, b = float(point.value("friction_a")), float(point.value("friction_b"))
        key = "equal" if a == b else "A" if a > b else "B"
        found[key] = float(point.output("axial_drift_mm")), float(point.output("travel_mm"))
    if len(found) < 3:
        raise MissingPointError("the needle between plates was not run with equal and with both unequal frictions")
    return found


def _locus_straight(evidence: Evidence, cases: Cases) -> Measured:
    drift, travel = _loci(evidence)["equal"]
    return Measured(100 * abs(drift / travel), note=f"Drift {number(drift)} mm, travel {number(travel)} mm.")


def _loci_apart(evidence: Evidence, cases: Cases) -> Measured:
    loci = _loci(evidence)
    told = ", ".join(f"{key}: {drift:+.3g} mm" for key, (drift, _) in loci.items())
    return Measured(loci["A"][0] / loci["B"][0], note=f"Drift for each plate with more friction: {told}.")


def _with_groove_friction(evidence: Evidence, cases: Cases) -> Measured:
    frictions, amplitudes = _line(evidence, cases, 2, "groove_sliding_friction", 3)
    straight = _fit(frictions, amplitudes)
    return Measured(straight[2], note=_told(frictions, amplitudes, ""))


_SWITCHING = {
    "groove_sliding": ("Groove sliding contributes the rest of the third order", "it is the main factor"),
    "groove_spinning": ("Groove spinning contributes 2 % of the third order", ""),
    "groove_rolling": ("Groove rolling contributes 5 % of the third order", ""),
    "needle_rolling": ("Needle rolling contributes 6 % of the third order", ""),
    "needle_sliding": ("Needle sliding contributes 1 % of the third order", ""),
}
_SHARE_TOLERANCE = 4.0  # percentage points, by at least one stated definition


def _share_rule(mechanism: str) -> Rule:
    paper = PAPER_SHARES.get(mechanism, 100 - sum(PAPER_SHARES.values()))
    statement, more = _SWITCHING[mechanism]
    return Rule(
        f"share_{mechanism}", f"{statement}{f': {more}' if more else ''}", "3.5, Fig. 19",
        "share by the definition whose value is closest to the paper's", "%", paper - _SHARE_TOLERANCE,
        paper + _SHARE_TOLERANCE, _share(mechanism),
    )  # fmt: skip


RULES: tuple[Rule, ...] = (
    Rule("degrees_of_freedom", "The model with 27 needles per trunnion has 18 N_n + 21 degrees of freedom",
         "2.4, Eq. 9", "velocities of the bodies minus constraints", "1", 507, 507, _degrees_of_freedom),
    Rule("friction_from_rest", "The friction coefficient grows continuously from rest, as a hyperbolic tangent",
         "2.3, Fig. 4; 3.1", "largest deviation of the coefficient at a roller, in percent of its full value", "%",
         None, 0.1, _friction_from_rest),
    Rule("locus_equal_friction", "A skewed needle between plates of equal friction does not drift", "2.3.3, Fig. 8(b)",
         "drift over travel", "%", None, 0.1, _locus_straight),
    Rule("loci_unequal_friction", "A needle drifts to opposite sides with more friction at one plate or at the other",
         "2.3.3, Fig. 8(b)", "drift with more friction at A over drift with more at B", "1", -1.05, -0.95, _loci_apart),
    Rule("third_order_dominant", "The third order is clearly visible", "3.2, Fig. 10; 3.3, Fig. 13",
         "next largest order over the third, cases 1 and 2", "1", None, 0.25, _third_dominates),
    Rule("beat_visible", "A beat occurs in case 2", "3.2, Fig. 10", "second over third order", "%", 5, None, _beat,
         reasons.FAINT_BEAT),
    Rule("second_above_fourth", "The beat is due to the second order, which is more visible than the fourth",
         "3.3, Fig. 13", "fourth over second order, case 2", "1", None, 0.5, _second_above_fourth),
    Rule("skew_stays", "The skew stays near its initial value", "3.2, Fig. 11",
         "largest change of the mean skew up to the fourth revolution, cases 1 and 2", "%", None, 35, _skew_stays,
         reasons.SKEW_GROWS),
    Rule("third_independent_of_case", "The third order is the same in all cases of skew", "3.3, Fig. 14",
         "largest deviation from the mean of cases 1 to 4", "%", None, 1, _same_third),
    Rule("third_cases_over_angle", "Cases 1 and 2 have the same third order at all joint angles", "3.3, Fig. 14",
         "largest deviation from their mean", "%", None, 1, _same_third_over_angle),
    Rule("third_linear_in_angle", "The third order is a linear function of the joint angle", "3.3, Fig. 14",
         "R^2 of the line over 4 to 14 deg, the smaller of cases 1 and 2", "1", 0.999, None, _straight),
    Rule("third_proportional_to_angle", "The third order is proportional to the joint angle", "3.3, Fig. 14; 4 (1)(b)",
         "offset of the line over its value at 10 deg", "%", None, 5, _offset, reasons.ROLLING_STAYS),
    Rule("third_proportional_to_torque", "The third order is proportional to the torque", "3.3",
         "largest deviation of amplitude over torque from its mean", "%", None, 2, _torque),
    Rule("third_independent_of_speed", "The third order is independent of the speed", "3.3",
         "largest deviation from the mean", "%", None, 5, _speed),
    Rule("second_from_skew", "Uneven skew causes the second order, which almost vanishes without skew", "3.3; 3.4",
         "second order without skew over that of case 2", "%", None, 20, _without_skew, reasons.NOT_STRAIGHT),
    Rule("second_follows_skew", "The second order corresponds to the magnitude of the skew", "3.3, Fig. 14",
         "ratio of the second orders of cases 2 and 1 over that of their skews", "1", 0.85, 1.15, _with_skew),
    Rule("second_independent_of_angle", "The second order is independent of the joint angle", "3.3, Fig. 14",
         "largest deviation from the mean over 4 to 14 deg, the larger of cases 1 and 2", "%", None, 20,
         _second_over_angle, reasons.SMALL_SECOND),
    Rule("second_vanishes_equal_skews", "With equal skews there is no beat", "3.4, Fig. 18 case 3",
         "second order of case 3 over that of case 2", "%", None, 5, _equal_skews, reasons.NOT_EQUAL),
    Rule("local_phases_regular", "With equal skews the second orders of the grooves have equal phase differences",
         "3.4, Fig. 17", "largest deviation of their phase differences from those of equal grooves", "deg", None, 10,
         _regular),
    Rule("beat_turned", "The beat shifts by 180 deg when all skews are reversed", "3.4, Fig. 18 case 4",
         "phase of the second relative to the third order, case 4 minus case 2", "deg", 170, 190, _turned),
    Rule("first_order_local_only", "The first order of the grooves cancels in the sum", "3.4, Fig. 16(a)",
         "first order of the sum over the mean of the grooves", "%", None, 5, _local_first),
    Rule("third_is_three_local", "The third order of the sum is three times that of a groove", "3.4, Fig. 16(c)",
         "third order of the sum over the mean of the grooves", "1", 2.97, 3.03, _three_local),
    Rule("local_orders_dominant", "At a groove the orders 1, 2 and 3 dominate", "3.4, Fig. 16",
         "largest other order at a groove over the smallest of the three", "1", None, 1, _local_orders,
         reasons.FAINT_LOCAL),
    *(_share_rule(mechanism) for mechanism in _SWITCHING),
    Rule("third_follows_groove_friction", "The thrust's amplitude follows the friction coefficient of groove sliding",
         "3.5, Fig. 20", "R^2 of the line of the third order over the coefficient", "1", 0.99, None,
         _with_groove_friction),
    Rule("second_by_needle_sliding", "Sliding friction of the needles is the main factor of the second order",
         "3.5, Fig. 19; 4 (3)", "second order of case 2 without it over that with it", "%", None, 5, _needle_sliding),
)  # fmt: skip
"""All claims, in the order of the paper."""
