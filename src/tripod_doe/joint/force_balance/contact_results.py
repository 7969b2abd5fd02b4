"""Forces and motion at the contacts of a solved balance, read from its memory if a study requests them."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from tripod_doe.array_types import FloatArray
from tripod_doe.joint.contact_outputs import NEEDLE_NAMES
from tripod_doe.joint.derived_constants.contact_pressure import groove_pressure, needle_pressure
from tripod_doe.joint.derived_constants.load_zone import bearing_load_zone
from tripod_doe.joint.force_balance.added_motion import added_motion
from tripod_doe.joint.force_balance.needle_correction import Followers
from tripod_doe.joint.force_balance.point_constants import PointConstants, flank, point_constants_of
from tripod_doe.joint.force_balance.roller_forces import groove_forces, leaning_contact
from tripod_doe.joint.force_balance.samples import Memory, motion_at, skew_of, start
from tripod_doe.joint.values import JointValues
from tripod_doe.mechanics.arithmetic.simd_lanes import WIDTH, load, store
from tripod_doe.mechanics.compilation.first_compilation import first_compilation
from tripod_doe.mechanics.compilation.kernels import kernel
from tripod_doe.mechanics.laws.needles import needle_grip, needle_slip

_READ = (
    "groove_normal_force",
    "groove_friction_force",
    "slip_outward",
    "slip_along",
    "groove_spin",
    "groove_contact_place_mm",
    "groove_contact_angle_deg",
    "roller_contact_place_mm",
    "roller_place_mm",
    "roller_tilt_deg",
)
"""Quantities that the kernel reads, in its order: velocities of slip outward from the joint's axis and along it."""
_ANGLES = ("groove_contact_angle_deg", "roller_tilt_deg")


@kernel
def _read(row, memory, found):
    """Read all of `_READ` at every groove and sample, shape (quantity, groove, eights, 8); mm, mm/s, N, rad."""
    p = point_constants_of(row)
    sigma, eccentricity = flank(p), 0.5 * p.pitch_radius * (1.0 - p.cos_theta) / p.cos_theta
    arm = sigma * p.roller_radius
    for k in range(3):
        cosine, sine = memory.turns[k, 0], memory.turns[k, 1]
        for b in range(memory.eights.shape[1]):
            e = memory.eights[k, b]
            cos_phi, root, lean = load(e.cosine, 0), load(e.root, 0), load(e.lean, 0)
            m = motion_at(p, cos_phi, load(e.sine, 0))
            contact = leaning_contact(p, m, lean)
            given = load(e.needle_force, 0), load(e.needle_moment, 0), load(e.needle_swing, 0), load(e.steering, 0)
            past = load(e.past_tilt, 0), load(e.past_spin, 0)
            added = added_motion(p, m, contact, cos_phi, root, past[0], past[1], given)
            g = groove_forces(p, m, skew_of(memory.turns, k), contact, load(e.slip, 0), root, added, 1.0)
            # the slip, as in `groove_forces`
            v_tau = arm * (m.w_z + g.spin * g.axis_z) + added.swing
            w_tau = contact.cos_a * m.w_r - contact.sin_a * m.w_t + g.spin * contact.t_tau
            v_z = m.along_groove - arm * w_tau + added.plunge * m.t_z
            w_n = contact.sin_a * m.w_r + contact.cos_a * m.w_t + g.spin * contact.t_n
            normal, off = load(e.normal, 0), m.distance - (p.pitch_radius + eccentricity)
            plunge = m.along_trunnion + added.plunge + added.rocking
            slip = needle_slip(plunge, g.spin, p.needle_lever, (cosine, sine))
            held = given[0] - p.needle_friction * cosine * needle_grip(slip, p.needle_transition)
            # the load's place along the needles, which tilts the roller: `kinetostatic`
            offset = off + p.roller_radius * lean - (p.roller_radius - p.bearing_radius) * held
            tilt = sigma * p.tilt / p.roller_radius * offset
            store(found[0, k], b, normal)
            store(found[1, k], b, normal * (g.friction_tau * g.friction_tau + g.friction_z * g.friction_z) ** 0.5)
            store(found[2, k], b, v_tau)
            store(found[3, k], b, v_z)
            store(found[4, k], b, sigma * w_n)
            store(found[5, k], b, -p.pitch_radius * p.sin_theta / p.cos_theta * cos_phi)
            store(found[6, k], b, -sigma * contact.sin_a)
            store(found[7, k], b, -arm * contact.t_n)
            store(found[8, k], b, off)
            store(found[9, k], b, tilt)


@kernel
def _needle_depths(loads, clearance, stiffness, needle_count, depths):
    """Penetration of the most loaded needle under bearing loads, shape (load,)."""
    for i in range(loads.size):
        depths[i] = bearing_load_zone(loads[i], clearance, stiffness, needle_count)[1]


@cache
def _compile() -> None:
    """Compile the kernels that read contacts, once per process."""
    row, ones, memory = np.ones(len(PointConstants._fields)), np.ones((3, 1, WIDTH)), Memory.for_samples(WIDTH)
    with first_compilation("forces and motion at the contacts", seconds=8):
        start(row, np.zeros(3), ones, ones, memory)
        _read(row, memory, np.empty((len(_READ), *ones.shape)))
        _needle_depths(np.ones(1), 0.0, 1.0, 9.0, np.empty(1))


class ContactReader:
    """Contacts of a block of points, read one point after the other.

    Args:
        points: The points.
        names: Outputs that are wanted, from `contact_outputs`.
        samples: Samples of a revolution.
        outputs: Receives the outputs by name, with the point as first axis.
    """

    def __init__(
        self, points: JointValues[FloatArray], names: frozenset[str], samples: int, outputs: dict[str, FloatArray]
    ) -> None:
        self._points, self._names, self._samples = points, names, samples
        self._outputs = outputs
        _compile()

    @property
    def of_needles(self) -> bool:
        """Whether outputs of single needles are requested."""
        return bool(self._names & (NEEDLE_NAMES | {"needle_pressure_mpa", "largest_needle_pressure_mpa"}))

    def read(self, i: int, row: FloatArray, memory: Memory, followers: Followers | None) -> None:
        """Read the contacts of point i, whose balance is in `memory`; `row` holds its constants."""
        lanes = np.empty((len(_READ), *memory.eights.shape, memory.eights["normal"].shape[-1]))
        _read(row, memory, lanes)
        read = dict(zip(_READ, lanes.reshape(len(_READ), 3, -1)[..., : self._samples], strict=True))
        for name in _ANGLES:
            read[name] = np.degrees(np.arcsin(np.clip(read[name], -1.0, 1.0)))
        outward, along = read.pop("slip_outward"), read.pop("slip_along")
        read["groove_slip"] = np.hypot(outward, along)
        read["groove_slip_direction_deg"] = np.degrees(np.arctan2(outward, along))
        if followers is None:
            del read["roller_tilt_deg"]
        values = self._points.point(i)
        read["groove_pressure_mpa"] = groove_pressure(values, read["groove_normal_force"])
        records = None if followers is None else followers.recorded(i)
        normal = read["groove_normal_force"]
        read = {name: np.concatenate([data, data], axis=-1) for name, data in read.items()}  # two equal revolutions
        if records is not None:
            read |= _of_needles(records)
        if self.of_needles:
            line = self._line_loads(values, normal) if records is None else records["line"].max(axis=1)
            read["needle_pressure_mpa"] = np.broadcast_to(
                needle_pressure(values, line if line.shape[-1] != self._samples else np.tile(line, 2)),
                (3, 2 * self._samples),
            )
            read["largest_needle_pressure_mpa"] = read["needle_pressure_mpa"].max()
        read["largest_groove_pressure_mpa"] = read["groove_pressure_mpa"].max()
        for name in self._names & read.keys():
            data = np.asarray(read[name])
            if name not in self._outputs:
                self._outputs[name] = np.full((self._points.torque.size, *data.shape), np.nan)
            self._outputs[name][i] = data

    def _line_loads(self, values: JointValues[float], normal: FloatArray) -> FloatArray:
        """Load per length of the most loaded straight needle at each groove and sample, N/mm.

        Of the largest load alone, shape (1, 1), where only the largest pressure is wanted: it grows with the load.
        """
        if "needle_pressure_mpa" not in self._names:
            normal = normal.max(keepdims=True)
        depths = np.empty(normal.size)
        _needle_depths(
            normal.ravel(), values.bearing_radial_clearance, values.needle_stiffness, values.needle_count, depths
        )
        line: FloatArray = values.needle_stiffness * depths.reshape(normal.shape) ** (10 / 9) / values.needle_length
        return line


def _of_needles(records: NDArray[np.void]) -> dict[str, FloatArray]:
    """Outputs of single needles from their records, shape (trunnion, needle, sample)."""
    return {
        "needle_load": records["load"],
        "needle_angle_deg": np.degrees((records["angle"] + np.pi) % (2 * np.pi) - np.pi),
        "needle_place_mm": records["place"],
        "needle_yaw_deg": np.degrees(records["skew"]),
        "needle_stop_force": records["stop"],
    }
