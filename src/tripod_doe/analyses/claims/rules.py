"""What the paper claims, as rules: a number from the cubes, and the limits within which the claim holds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from tripod_doe.analyses.claims import order_measures as orders
from tripod_doe.analyses.claims import part_measures as parts
from tripod_doe.analyses.claims import reasons
from tripod_doe.analyses.claims.cases import Cases
from tripod_doe.analyses.claims.evidence import Evidence, Measured
from tripod_doe.analyses.contribution.contribution import PAPER_SHARES


@dataclass(frozen=True)
class Rule:
    """One claim."""

    name: str  # its identifier
    # statement, place: what the paper says, and where
    statement: str
    place: str
    # quantity, unit: the number that decides it
    quantity: str
    unit: str
    # low, high: limits within which it holds; None for none
    low: float | None
    high: float | None
    # the number, from the evidence; raises `MissingPointError` where its points are not there
    measure: Callable[[Evidence, Cases], Measured]
    why_not: str = ""  # the known reason if it does not hold


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
        f"share_{mechanism}",
        f"{statement}{f': {more}' if more else ''}",
        "3.5, Fig. 19",
        "share by the definition whose value is closest to the paper's",
        "%",
        paper - _SHARE_TOLERANCE,
        paper + _SHARE_TOLERANCE,
        parts.share_of(mechanism),
    )


RULES: tuple[Rule, ...] = (
    Rule(
        "degrees_of_freedom",
        "The model with 27 needles per trunnion has 18 N_n + 21 degrees of freedom",
        "2.4, Eq. 9",
        "velocities of the bodies minus constraints",
        "1",
        507,
        507,
        parts.degrees_of_freedom,
    ),
    Rule(
        "friction_from_rest",
        "The friction coefficient grows continuously from rest, as a hyperbolic tangent",
        "2.3, Fig. 4; 3.1",
        "largest deviation of the coefficient at a roller, in percent of its full value",
        "%",
        None,
        0.1,
        parts.friction_from_rest,
    ),
    Rule(
        "locus_equal_friction",
        "A skewed needle between plates of equal friction does not drift",
        "2.3.3, Fig. 8(b)",
        "drift over travel",
        "%",
        None,
        0.1,
        parts.locus_straight,
    ),
    Rule(
        "loci_unequal_friction",
        "A needle drifts to opposite sides with more friction at one plate or at the other",
        "2.3.3, Fig. 8(b)",
        "drift with more friction at A over drift with more at B",
        "1",
        -1.05,
        -0.95,
        parts.loci_apart,
    ),
    Rule(
        "third_order_dominant",
        "The third order is clearly visible",
        "3.2, Fig. 10; 3.3, Fig. 13",
        "next largest order over the third, cases 1 and 2",
        "1",
        None,
        0.25,
        orders.third_dominates,
    ),
    Rule(
        "beat_visible",
        "A beat occurs in case 2",
        "3.2, Fig. 10",
        "second over third order",
        "%",
        5,
        None,
        orders.beat,
        reasons.FAINT_BEAT,
    ),
    Rule(
        "second_above_fourth",
        "The beat is due to the second order, which is more visible than the fourth",
        "3.3, Fig. 13",
        "fourth over second order, case 2",
        "1",
        None,
        0.5,
        orders.second_above_fourth,
    ),
    Rule(
        "skew_stays",
        "The skew stays near its initial value",
        "3.2, Fig. 11",
        "largest change of the mean skew up to the fourth revolution, cases 1 and 2",
        "%",
        None,
        35,
        parts.skew_stays,
        reasons.SKEW_GROWS,
    ),
    Rule(
        "third_independent_of_case",
        "The third order is the same in all cases of skew",
        "3.3, Fig. 14",
        "largest deviation from the mean of cases 1 to 4",
        "%",
        None,
        1,
        orders.same_third,
    ),
    Rule(
        "third_cases_over_angle",
        "Cases 1 and 2 have the same third order at all joint angles",
        "3.3, Fig. 14",
        "largest deviation from their mean",
        "%",
        None,
        1,
        orders.same_third_over_angle,
    ),
    Rule(
        "third_linear_in_angle",
        "The third order is a linear function of the joint angle",
        "3.3, Fig. 14",
        "R^2 of the line over 4 to 14 deg, the smaller of cases 1 and 2",
        "1",
        0.999,
        None,
        orders.straight_over_angle,
    ),
    Rule(
        "third_proportional_to_angle",
        "The third order is proportional to the joint angle",
        "3.3, Fig. 14; 4 (1)(b)",
        "offset of the line over its value at 10 deg",
        "%",
        None,
        5,
        orders.offset_over_angle,
        reasons.ROLLING_STAYS,
    ),
    Rule(
        "third_proportional_to_torque",
        "The third order is proportional to the torque",
        "3.3",
        "largest deviation of amplitude over torque from its mean",
        "%",
        None,
        2,
        orders.over_torque,
    ),
    Rule(
        "third_independent_of_speed",
        "The third order is independent of the speed",
        "3.3",
        "largest deviation from the mean",
        "%",
        None,
        5,
        orders.over_speed,
    ),
    Rule(
        "second_from_skew",
        "Uneven skew causes the second order, which almost vanishes without skew",
        "3.3; 3.4",
        "second order without skew over that of case 2",
        "%",
        None,
        20,
        orders.without_skew,
        reasons.NOT_STRAIGHT,
    ),
    Rule(
        "second_follows_skew",
        "The second order corresponds to the magnitude of the skew",
        "3.3, Fig. 14",
        "ratio of the second orders of cases 2 and 1 over that of their skews",
        "1",
        0.85,
        1.15,
        orders.with_skew,
    ),
    Rule(
        "second_independent_of_angle",
        "The second order is independent of the joint angle",
        "3.3, Fig. 14",
        "largest deviation from the mean over 4 to 14 deg, the larger of cases 1 and 2",
        "%",
        None,
        20,
        orders.second_over_angle,
        reasons.SMALL_SECOND,
    ),
    Rule(
        "second_vanishes_equal_skews",
        "With equal skews there is no beat",
        "3.4, Fig. 18 case 3",
        "second order of case 3 over that of case 2",
        "%",
        None,
        5,
        orders.equal_skews,
        reasons.NOT_EQUAL,
    ),
    Rule(
        "local_phases_regular",
        "With equal skews the second orders of the grooves have equal phase differences",
        "3.4, Fig. 17",
        "largest deviation of their phase differences from those of equal grooves",
        "deg",
        None,
        10,
        orders.regular_phases,
    ),
    Rule(
        "beat_turned",
        "The beat shifts by 180 deg when all skews are reversed",
        "3.4, Fig. 18 case 4",
        "phase of the second relative to the third order, case 4 minus case 2",
        "deg",
        170,
        190,
        orders.turned_beat,
    ),
    Rule(
        "first_order_local_only",
        "The first order of the grooves cancels in the sum",
        "3.4, Fig. 16(a)",
        "first order of the sum over the mean of the grooves",
        "%",
        None,
        5,
        orders.local_first,
    ),
    Rule(
        "third_is_three_local",
        "The third order of the sum is three times that of a groove",
        "3.4, Fig. 16(c)",
        "third order of the sum over the mean of the grooves",
        "1",
        2.97,
        3.03,
        orders.three_local,
    ),
    Rule(
        "local_orders_dominant",
        "At a groove the orders 1, 2 and 3 dominate",
        "3.4, Fig. 16",
        "largest other order at a groove over the smallest of the three",
        "1",
        None,
        1,
        orders.local_orders,
        reasons.FAINT_LOCAL,
    ),
    *(_share_rule(mechanism) for mechanism in _SWITCHING),
    Rule(
        "third_follows_groove_friction",
        "The thrust's amplitude follows the friction coefficient of groove sliding",
        "3.5, Fig. 20",
        "R^2 of the line of the third order over the coefficient",
        "1",
        0.99,
        None,
        orders.with_groove_friction,
    ),
    Rule(
        "second_by_needle_sliding",
        "Sliding friction of the needles is the main factor of the second order",
        "3.5, Fig. 19; 4 (3)",
        "second order of case 2 without it over that with it",
        "%",
        None,
        5,
        orders.needle_sliding,
    ),
)
"""All claims, in the order of the paper."""
