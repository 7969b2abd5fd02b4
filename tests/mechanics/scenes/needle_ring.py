"""A full ring of needles between a trunnion and a bore, as on a tripod's trunnion: rows on rows, with end stops.

Trunnion and bore share the axis z; the trunnion is fixed, the ring rolls round it as the bore turns. The pitch radius
follows from the number of needles, so that rings of any size are packed alike.
"""

from __future__ import annotations

import math

from tripod_doe.mechanics.scene import GROUND, Body, Cylinder, Friction, Plane, Scene, SphereRow, Vector

_AXIS: Vector = (0.0, 0.0, 1.0)
_RADIUS, _LENGTH, _SPHERES = 1.0, 10.0, 7
_STIFFNESS = 8.15e4 * _LENGTH ** (8 / 9) / _SPHERES  # Table 1


def pitch_radius(needles: int, gap: float = 0.01) -> float:
    """Radius on which that many needles of radius 1 mm stand with a gap between neighbours."""
    return (2 * _RADIUS + gap) / (2 * math.sin(math.pi / max(needles, 3)))


def _needle(i: int, needles: int, pitch: float, orbit: float) -> Body:
    """Needle number i on its place, rolling round the trunnion."""
    mass = 7.85e-9 * math.pi * _RADIUS**2 * _LENGTH
    across = mass * (_RADIUS**2 / 4 + _LENGTH**2 / 12)
    cosine, sine = math.cos(2 * math.pi * i / needles), math.sin(2 * math.pi * i / needles)
    return Body(
        f"needle {i}",
        mass,
        (across, across, mass * _RADIUS**2 / 2),
        position=(pitch * cosine, pitch * sine, 0.0),
        velocity=(-orbit * pitch * sine, orbit * pitch * cosine, 0.0),
        angular_velocity=(0.0, 0.0, orbit * pitch / _RADIUS),
    )


def _contacts(i: int, needles: int, trunnion: float, bore: float, friction: Friction) -> list[SphereRow]:
    """Contacts of needle i with trunnion, bore and the next needle, and of a point at each end with its end stop."""
    name, after = f"needle {i}", f"needle {(i + 1) % needles}"
    surfaces = (
        Cylinder(GROUND, trunnion, axis=_AXIS),
        Cylinder("roller", bore, axis=_AXIS, concave=True),
        Cylinder(after, _RADIUS, axis=_AXIS),
    )
    rows = [
        SphereRow(
            name,
            surface,
            _RADIUS,
            _STIFFNESS,
            axis=_AXIS,
            count=_SPHERES,
            length=_LENGTH,
            friction=friction,
            exponent=10 / 9,
            damping=1e-3,
        )
        for surface in surfaces
    ]
    ends = [
        SphereRow(
            name,
            Plane(GROUND, (0.0, 0.0, side * (_LENGTH / 2 + 0.1)), (0.0, 0.0, -side)),
            0.0,
            _STIFFNESS,
            centre=(0.0, 0.0, side * _LENGTH / 2),
            friction=friction,
            exponent=10 / 9,
            damping=1e-3,
        )
        for side in (-1.0, 1.0)
    ]
    return rows + ends


def needle_ring(
    needles: int, preload: float = 1e-3, speed: float = 20.0, load: float = 0.0, gap: float = 0.01
) -> Scene:
    """A ring that starts to roll without slip.

    Parameters
    ----------
    needles
        Number of needles, 3 or more.
    preload
        Penetration of every needle into trunnion and bore at the start; a negative one is a clearance. mm
    speed
        Angular velocity of the bore, rad/s.
    load
        Force on the roller along x, N.
    gap
        Gap between neighbours, mm.
    """
    pitch = pitch_radius(needles, gap)
    bore, trunnion = pitch + _RADIUS - preload, pitch - _RADIUS + preload
    orbit = speed * bore / (2 * pitch)
    friction = Friction(0.03, max(0.05 * abs(speed), 1e-3), 0.002, _RADIUS, max(0.25 * abs(speed), 1e-3))
    roller_mass = 7.85e-9 * math.pi * ((bore + 6.0) ** 2 - bore**2) * _LENGTH
    inertia = roller_mass * (bore + 3.0) ** 2
    roller = Body(
        "roller",
        roller_mass,
        (0.6 * inertia, 0.6 * inertia, inertia),
        angular_velocity=(0.0, 0.0, speed),
        force=(load, 0.0, 0.0),
        locked=(False, False, True, True, True, True),
    )
    bodies = [roller, *(_needle(i, needles, pitch, orbit) for i in range(needles))]
    contacts = [contact for i in range(needles) for contact in _contacts(i, needles, trunnion, bore, friction)]
    return Scene(
        tuple(bodies),
        contacts=tuple(contacts),
        length_scale=0.1,
        speed_scale=abs(speed) * pitch + 1.0,
        rotation_scale=abs(speed) + 1.0,
    )
