"""Why claims of the paper do not hold: reasons from varying the model at the reference point."""

from __future__ import annotations

FAINT_BEAT = (
    "The second order is proportional to the skew, and the long cylindrical needles of the assumed joint keep a skew "
    "only up to about half a degree: a skewed needle touches the trunnion at its middle and the bore at its ends, and "
    "these contacts turn it back. Needles of half the length, with a crown of 5 um and clear of their stops, keep 1 to "
    "3 deg and reach a second order of 8 % of the third (studies/beat.toml)."
)
FAINT_LOCAL = "Orders 1 and 3 dominate; the second is small at each groove because the remaining skews are small."
ROLLING_STAYS = (
    "Rolling friction does not decrease with the joint angle as groove sliding does; its part of the thrust is the "
    "offset: without groove rolling and needle rolling, model rollers has an offset of 0.8 % instead of 8.8 %."
)
SKEW_GROWS = (
    "The skew of a loaded needle tends to a value that depends on its bearing, here about half a degree: the stops, "
    "between which it slides with the roller, push it along its axis and increase the skew, and the wedge-shaped gap "
    "between trunnion and bore reduces it. Case 2 starts near that skew and changes by less than a third, case 1 with "
    "its smaller skew by more (studies/skew_choice.toml, studies/beat.toml)."
)
SMALL_SECOND = (
    "The part of the second order that reverses with the initial skew is independent of the joint angle (half the "
    "difference between case 1 and its reverse is 0.107, 0.113, 0.104 N at 4, 8, 14 deg). The part that does not "
    "reverse is due to skew that the needles develop during the run; it grows from 0.01 to 0.06 N and makes the small "
    "second order of case 1 depend on the angle."
)
NOT_STRAIGHT = (
    "Needles that start without skew develop some in the first revolutions. It differs between the trunnions, since "
    "each starts at a different phase of the load cycle."
)
NOT_EQUAL = (
    "Equal initial skews do not stay equal, since each trunnion starts at a different phase of the load cycle. Neither "
    "numerical error is the cause (the same with half and a quarter of the tolerance) nor the shaft (the same with ten "
    "times its length) nor the start alone (the same after eight revolutions instead of four); model rollers, which "
    "has no needles, does not show it. With larger skews it decreases: 3 % at 0.8 deg (studies/skew_choice.toml)."
)
