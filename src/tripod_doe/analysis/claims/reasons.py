"""Why claims of the paper do not hold: reasons found by varying the model at the reference point."""

from __future__ import annotations

__all__ = [
    "FAINT_BEAT",
    "FAINT_LOCAL",
    "NOT_EQUAL",
    "NOT_STRAIGHT",
    "ROLLING_STAYS",
    "SKEW_GROWS",
    "SMALL_SECOND",
]

FAINT_BEAT = (
    "The second order is in proportion to a skew that the long cylindrical needles of the assumed joint keep only up "
    "to about half a degree: a skewed one touches the trunnion in its middle and the bore at its ends, and turns back. "
    "Needles half as long, crowned by 5 um and free of their stops keep 1 to 3 deg and beat by 8 % (studies/beat.toml)."
)
FAINT_LOCAL = "Orders 1 and 3 dominate; the second is as small at a groove as the kept skews make it."
ROLLING_STAYS = (
    "Rolling friction does not fall with the joint angle as the groove's sliding does, and its part is the offset: "
    "without both rolling resistances model rollers has 0.8 % instead of 8.8 %."
)
SKEW_GROWS = (
    "A loaded needle drifts to a skew that its bearing sets, here about half a degree: the stops, between which it "
    "slides with the roller, push it along its axis and turn it further, and the wedge between trunnion and bore turns "
    "it back. Case 2 starts near that skew and changes by less than a third, the small case 1 by more "
    "(studies/skew_choice.toml, studies/beat.toml)."
)
SMALL_SECOND = (
    "What turns with the skew is independent of the angle (half the difference of case 1 and its reverse is 0.107, "
    "0.113, 0.104 N at 4, 8, 14 deg). What does not turn comes of skew that the needles take up on their own; it grows "
    "from 0.01 to 0.06 N and spoils the small second order of case 1."
)
NOT_STRAIGHT = (
    "Needles that start straight take some skew in the first revolutions, on each trunnion another, since each starts "
    "at another place of the load's cycle."
)
NOT_EQUAL = (
    "Skews that start equal do not stay equal, since each trunnion starts at another place of the load's cycle. It is "
    "no numerical error (the same with half and a quarter of the tolerance), not the shaft (ten times as long) and not "
    "the start alone (eight revolutions instead of four); model rollers, which has no needles, shows none of it. "
    "With larger skews it fades: 3 % at 0.8 deg (studies/skew_choice.toml)."
)
