"""The needle bearing between trunnion and roller: needles as bodies (model needles) or one element (model rollers)."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from tripod_doe.joint.multibody.initial_state import GROOVE_ANGLES, Pose
from tripod_doe.joint.multibody.scene_constants import DerivedConstants, moving_body, vector
from tripod_doe.mechanics.scene import Body, Cylinder, Friction, NeedleBearing, Plane, SphereRow

_EXPONENT = 10 / 9
_Z = np.array([0.0, 0.0, 1.0])


def needle_body(derived: DerivedConstants, k: int, j: int, roller: Body) -> Body:
    """Needle j of trunnion k, counted from the middle of the load zone about the outward trunnion axis."""
    values, shaft = derived.values, derived.initial.shaft
    pose = derived.initial.rollers[k]
    axis = pose.attitude.apply(_Z)
    flank = -derived.side * np.array([-math.sin(GROOVE_ANGLES[k]), math.cos(GROOVE_ANGLES[k]), 0.0])
    load = flank - axis * (flank @ axis)
    angle = 2 * math.pi * j / values.needle_count
    normal = Rotation.from_rotvec(angle * axis).apply(load / np.linalg.norm(load))
    # in the middle of the gap between trunnion and bore, which the load has shifted
    shift = values.bearing_radial_clearance + 2 * derived.needle_load
    middle = (values.trunnion_radius + values.bore_radius - shift * math.cos(angle)) / 2
    arm = derived.ring_distance * axis + middle * normal
    skew = values.initial_skews[k]
    own = Rotation.from_rotvec(skew * normal).apply(axis)
    spin = (np.array(roller.angular_velocity) - shaft.rotation) @ axis
    pitch, radius = values.bearing_radius, values.needle_radius
    orbit = spin * values.bore_radius / (2 * pitch)
    rotation = shaft.rotation + orbit * axis + orbit * (pitch / radius - 1) * own
    velocity = shaft.velocity + np.cross(shaft.rotation + orbit * axis, arm)
    mass = values.needle_mass
    across = mass * (radius**2 / 4 + values.needle_length**2 / 12)
    attitude = Rotation.from_matrix(np.column_stack([normal, np.cross(own, normal), own]))
    place = Pose(shaft.position + arm, attitude, velocity, rotation)
    return moving_body(f"needle {k + 1}.{j + 1}", mass, (across, across, mass * radius**2 / 2), place)


def needle_contacts(derived: DerivedConstants, k: int, j: int) -> list[SphereRow]:
    """Contacts of needle j with trunnion, bore and next needle, and of its ends with flange and retainer."""
    values = derived.values
    count = int(values.needle_count)
    name, roller, radius = f"needle {k + 1}.{j + 1}", f"roller {k + 1}", values.needle_radius
    axis, length = derived.trunnion_axis(k), values.needle_length

    def row(surface: Cylinder | Plane, friction: Friction, **shape: Any) -> SphereRow:
        return SphereRow(
            name,
            surface,
            stiffness=derived.sphere_stiffness,
            exponent=_EXPONENT,
            damping=values.contact_damping,
            damping_time=values.contact_damping_time,
            friction=friction,
            **shape,
        )

    line = {
        "radius": radius,
        "axis": (0.0, 0.0, 1.0),
        "length": length,
        "count": int(values.spheres_per_needle),
        "crown": values.needle_crown,
    }
    trunnion = Cylinder("shaft", values.trunnion_radius, vector(derived.spider_in_shaft), vector(axis))
    bore = Cylinder(roller, values.bore_radius, axis=(0.0, 0.0, 1.0), concave=True)
    rows = [row(trunnion, derived.needle[0], **line), row(bore, derived.needle[1], **line)]
    if count > 1:
        after = Cylinder(f"needle {k + 1}.{(j + 1) % count + 1}", radius, axis=(0.0, 0.0, 1.0))
        rows.append(row(after, derived.needle_end, **line))
    reach = (length + values.needle_axial_clearance) / 2
    for side in (-1.0, 1.0):
        stop = derived.spider_in_shaft + (derived.ring_distance + side * reach) * axis
        plane = Plane("shaft", vector(stop), vector(-side * axis))
        rows.append(row(plane, derived.needle_end, radius=0.0, centre=(0.0, 0.0, side * length / 2)))
    return rows


def lumped_bearing(derived: DerivedConstants, k: int) -> NeedleBearing:
    """All needles of trunnion k as one element, at their initial skew."""
    values, axis = derived.values, derived.trunnion_axis(k)
    middle = derived.spider_in_shaft + derived.ring_distance * axis
    passed_on = min(
        values.needle_rolling_friction, values.needle_sliding_friction
    )  # limit of the friction that makes needles roll
    friction = Friction(
        values.needle_sliding_friction,
        derived.needle_end.sliding_transition,
        passed_on,
        rolling_transition=derived.roller_spin_transition,
    )
    return NeedleBearing(
        Cylinder("shaft", values.trunnion_radius, vector(middle), vector(axis)),
        Cylinder(f"roller {k + 1}", values.bore_radius, axis=(0.0, 0.0, 1.0), concave=True),
        values.needle_diameter,
        values.needle_length,
        int(values.needle_count),
        derived.sphere_stiffness,
        _EXPONENT,
        int(values.spheres_per_needle),
        values.needle_crown,
        values.contact_damping,
        values.contact_damping_time,
        values.initial_skews[k],
        friction,
    )
