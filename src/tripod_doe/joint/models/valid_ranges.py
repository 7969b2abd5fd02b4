"""Valid ranges of the models: quantities of an operating point beyond which a model is doubtful, and why."""

from tripod_doe.joint.known_errors.operating_ratios import RATIOS, TOUCHING, TOUCHING_MEANING
from tripod_doe.joint.known_errors.vibration_record import SHARE, SHARE_MEANING
from tripod_doe.model_interface import ValidRange

NOT_PRELOADED = ValidRange(
    "bearing_radial_clearance_mm", "below, the bearing is preloaded, and no such joint is on record", low=0, unit="mm"
)

CROWN_FOLLOWED = ValidRange(
    TOUCHING,
    "below, so few spheres follow the load of a crowned needle coarsely",
    low=1.5,
    meaning=TOUCHING_MEANING,
    remedy="raise spheres_per_needle",
)
"""Of 160 joints with crowns of 2 to 40 um, nine of ten third orders of `kinetostatic` are within 1.1 % of those with 51
spheres inside it, and within 6 % outside (24 % at most)."""

_NO_PRELOAD = ValidRange(
    "bearing_radial_clearance_mm", "below, the bearing is preloaded and carries load all around", low=0, unit="mm"
)
NO_CROWN = ValidRange(
    "needle_crown_um", "beyond, rollers tilt more easily on their needles than the model assumes", high=0, unit="um"
)

SLOW = ValidRange(
    "inertia_ratio", "beyond, inertia matters, and the model neglects it", high=0.03, meaning=RATIOS["inertia_ratio"]
)

_CALM = ValidRange(
    SHARE,
    "beyond, joints often vibrate by themselves, which the model leaves out; model rollers includes vibration",
    high=0.1,
    meaning=SHARE_MEANING,
)


def within(swing: float, needle: float) -> tuple[ValidRange, ...]:
    """Valid range of a balance: inside it, errors at nine of ten measured points (`error_estimate`) are within 5 %."""
    return (
        ValidRange(
            "swing_ratio",
            "beyond, rollers swing in their grooves in ways that the model leaves out",
            high=swing,
            meaning=RATIOS["swing_ratio"],
        ),
        ValidRange(
            "needle_ratio",
            "beyond, needles hold the rollers back, and the thrust is a small difference of large forces",
            high=needle,
            meaning=RATIOS["needle_ratio"],
        ),
        _NO_PRELOAD,
        _CALM,
    )
