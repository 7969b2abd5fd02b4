"""What mass, and motion between samples, add to the forces of a roller: derived in `kinetostatic`.

All formulas take eight samples at a time (`lanes`).
"""

from __future__ import annotations

from tripod_doe.joint.balance_constants import flank
from tripod_doe.joint.roller_balance import AddedMotion, groove_forces, leaning_contact
from tripod_doe.mechanics.compilation import inlined_kernel
from tripod_doe.mechanics.lanes import load

__all__ = ["added_motion", "inertial_force", "moving_forces", "spider_load"]


@inlined_kernel
def inertial_force(p, cos_phi):
    """Inertial force of a roller in N, radially outward and along the groove."""
    centrifugal = p.roller_mass * p.pitch_radius * p.omega * p.omega
    return centrifugal, -centrifugal * p.sin_theta / p.cos_theta * cos_phi


@inlined_kernel
def added_motion(p, m, contact, cos_phi, root, past_tilt, past_spin):
    """What mass and motion add; `past_tilt` and `past_spin` are the earlier samples' part of backward differences.

    As its contact wanders round the groove the roller swings, and so slides on its trunnion, and tilts on it.
    """
    leaning = -flank(p) * p.pace * (1.5 * contact.sin_a + past_tilt) / contact.cos_a
    reach = p.play + p.tilt * p.roller_radius
    radius = root / p.axis_factor
    load = radius * (radius * radius)
    outward, along_groove = inertial_force(p, cos_phi)
    return AddedMotion(
        p.play * leaning / contact.t_tau,
        reach * leaning + p.tilt * m.along_trunnion,
        reach * p.pace / contact.steepness,
        p.roller_inertia * p.pace / load,
        past_spin,
        (outward * m.t_r + along_groove * m.t_z) / load,
    )


@inlined_kernel
def moving_forces(p, m, e, skew, newton):
    """Forces of a roller at eight samples, with what mass and motion add; slopes as for `groove_forces`."""
    root, contact = load(e.root, 0), leaning_contact(p, m, load(e.lean, 0))
    added = added_motion(p, m, contact, load(e.cosine, 0), root, load(e.past_tilt, 0), load(e.past_spin, 0))
    return groove_forces(p, m, skew, contact, load(e.slip, 0), root, added, newton)


@inlined_kernel
def spider_load(p, m, cos_phi, sin_phi):
    """What the inertia of one roller and a third of the shaft does to the spider.

    Two forces across the shaft in N, and the moment about the shaft in N mm.
    """
    outward, along = inertial_force(p, cos_phi)
    about_r = m.distance * m.t_t * along
    about_t = m.distance * (m.t_z * outward - m.t_r * along)
    about_z = -m.distance * m.t_t * outward
    eccentricity = 0.5 * p.pitch_radius * (1.0 - p.cos_theta) / p.cos_theta
    orbit = -3.0 * p.shaft_mass * p.omega * p.omega * eccentricity
    cos_three_phi = (4.0 * (cos_phi * cos_phi) - 3.0) * cos_phi
    sin_three_phi = (3.0 - 4.0 * (sin_phi * sin_phi)) * sin_phi
    return (
        outward * cos_phi * p.cos_theta - along * p.sin_theta + orbit * cos_three_phi,
        outward * sin_phi + orbit * sin_three_phi,
        (about_r * cos_phi - about_t * sin_phi) * p.sin_theta + about_z * p.cos_theta,
    )
