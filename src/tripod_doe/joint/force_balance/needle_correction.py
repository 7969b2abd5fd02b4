"""Correction of the `kinetostatic` balance by needles that follow its rollers.

The balance treats the needles of a trunnion as one, at one skew and with equal slip on trunnion and bore.
`needle_motion` moves every needle along the motion of the balance; the difference of its forces from that law is added
to the balance at every sample, which is then solved again.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tripod_doe.array_types import FloatArray
from tripod_doe.joint.force_balance.added_motion import added_motion
from tripod_doe.joint.force_balance.point_constants import TILT, PointConstants, flank, point_constants_of
from tripod_doe.joint.force_balance.roller_forces import leaning_contact
from tripod_doe.joint.force_balance.samples import Memory, motion_at
from tripod_doe.joint.needles.bearing_tilt import NeedleRow, turned_bearing
from tripod_doe.joint.needles.needle_constants import NeedleConstants
from tripod_doe.joint.needles.needle_motion import (
    FARTHEST,
    MOST_NEEDLES,
    NEEDLE,
    NEEDLE_CONTACT,
    RECORD,
    NeedleForces,
    RollerMotion,
    follow_roller,
)
from tripod_doe.joint.values import JointValues
from tripod_doe.mechanics.arithmetic.lanes import WIDTH, load, spread, store
from tripod_doe.mechanics.compilation.by_reference import ByReference
from tripod_doe.mechanics.compilation.kernels import kernel, kernel_part
from tripod_doe.mechanics.laws.needles import needle_grip, needle_slip


@dataclass(frozen=True, eq=False)
class NeedleMemory(ByReference):
    """Memory of the kernels while needles follow the rollers of a point."""

    # spins, plunges, loads, offsets, yaws, turns: as in `needle_motion.RollerMotion`, of every roller, shape (3,
    # eights, 8)
    spins: FloatArray
    plunges: FloatArray
    loads: FloatArray
    offsets: FloatArray
    yaws: FloatArray
    turns: FloatArray
    held: FloatArray  # force of needles that keep their skew along every trunnion, over N, shape (3, eights, 8)
    # needles, contacts: records of the needles of one trunnion
    needles: NDArray[np.void]
    contacts: NDArray[np.void]
    # forces, moments, places: of the needles of one trunnion, shape (sample,)
    forces: FloatArray
    moments: FloatArray
    places: FloatArray

    @classmethod
    def for_samples(cls, samples: int) -> NeedleMemory:
        """Memory for a number of samples per revolution."""
        shape = (3, -(-samples // WIDTH), WIDTH)
        return cls(
            np.zeros(shape),
            np.zeros(shape),
            np.zeros(shape),
            np.zeros(shape),
            np.zeros(shape),
            np.zeros(shape),
            np.zeros(shape),
            np.zeros(MOST_NEEDLES, NEEDLE),
            np.zeros((MOST_NEEDLES, 2), NEEDLE_CONTACT),
            np.zeros(samples),
            np.zeros(samples),
            np.zeros(samples),
        )

    def of_roller(self, k: int, samples: int) -> RollerMotion:
        """The motion of one roller."""
        motion = (self.spins, self.turns, self.plunges, self.loads, self.offsets, self.yaws)
        return RollerMotion(*(values[k].reshape(-1)[:samples] for values in motion))


@kernel
def _read_motions(row, memory, ring):
    """Read the motion of every roller on its trunnion off the balance."""
    p = point_constants_of(row)
    eccentricity, nothing = 0.5 * p.pitch_radius * (1.0 - p.cos_theta) / p.cos_theta, spread(0.0)
    for k in range(3):
        cosine, sine = memory.turns[k, 0], memory.turns[k, 1]
        for b in range(memory.eights.shape[1]):
            e = memory.eights[k, b]
            cos_phi, lean = load(e.cosine, 0), load(e.lean, 0)
            m = motion_at(p, cos_phi, load(e.sine, 0))
            contact = leaning_contact(p, m, lean)
            past, given = (load(e.past_tilt, 0), load(e.past_spin, 0)), (nothing, nothing, nothing, load(e.steering, 0))
            added = added_motion(p, m, contact, cos_phi, load(e.root, 0), *past, given)
            spin, plunge = load(e.spin, 0), m.along_trunnion + added.plunge + added.rocking
            slip = needle_slip(plunge, spin, p.needle_lever, (cosine, sine))
            force = -p.needle_friction * cosine * needle_grip(slip, p.needle_transition)
            off = m.distance - (p.pitch_radius + eccentricity)
            store(ring.spins[k], b, spin)
            store(ring.plunges[k], b, plunge)
            store(ring.turns[k], b, m.w_r * m.t_r + m.w_t * m.t_t + m.w_z * m.t_z)
            store(ring.yaws[k], b, flank(p) * load(e.steering, 0))
            store(ring.loads[k], b, load(e.normal, 0))
            store(ring.held[k], b, force)
            store(ring.offsets[k], b, off + p.roller_radius * lean - (p.roller_radius - p.bearing_radius) * force)


@kernel_part
def _add_forces(row, memory, ring, k, skew):
    """Add the forces of the needles of trunnion k beyond the balance's own law, which gets their mean skew."""
    p, samples = point_constants_of(row), memory.samples
    cosine, sine = math.cos(skew), math.sin(skew)
    memory.turns[k, 0], memory.turns[k, 1] = cosine, sine
    for j in range(WIDTH * memory.eights.shape[1]):
        at = j if j < samples else j - samples
        e, i = memory.eights[k, j // WIDTH], j % WIDTH
        b, lane = at // WIDTH, at % WIDTH
        slip = needle_slip(ring.plunges[k, b, lane], ring.spins[k, b, lane], p.needle_lever, (cosine, sine))
        drag = p.needle_friction * needle_grip(slip, p.needle_transition)
        e.needle_force[0, i] = ring.forces[at] + drag * cosine
        e.needle_moment[0, i] = ring.moments[at] - drag * p.needle_lever * sine


@kernel_part
def _add_swing(row, memory, k, forces, places):
    """Add the swing of roller k that the balance's own tilt misses.

    Its needles' friction acts at their pitch circle, not at the groove, and their middle moves. `forces` and `places`
    along the trunnion have the shape (sample,).
    """
    p, samples = point_constants_of(row), memory.samples
    shorter = p.roller_radius - p.bearing_radius
    for j in range(WIDTH * memory.eights.shape[1]):
        at = j if j < samples else j - samples
        before, after = at - 1 if at > 0 else samples - 1, at + 1 if at < samples - 1 else 0
        nearer = shorter * (forces[after] - forces[before]) + places[after] - places[before]
        memory.eights[k, j // WIDTH].needle_swing[0, j % WIDTH] = -0.5 * p.pace * p.tilt * nearer


@kernel
def _add_needles(row, memory, ring, k, skew):
    """Add the effects of the needles of trunnion k to the balance; `skew` is their mean."""
    _add_forces(row, memory, ring, k, skew)
    _add_swing(row, memory, k, ring.forces, ring.places)


@dataclass(frozen=True)
class Followers:
    """Needles of a block of points."""

    slide: NDArray[np.bool_]  # whether the needles of a point slide, and the joint is bent and turns; shape (point,)
    # of the needle that carries the most, rad, over all revolutions, shape (point, trunnion, cycles sample)
    skews: FloatArray
    settled: NDArray[np.bool_]  # whether the balance settled with moving needles, shape (point,)
    _loads: FloatArray  # mean normal force at a groove, shape (point,)
    _table: FloatArray
    _initial: FloatArray
    _memory: NeedleMemory
    _rollers: tuple[RollerMotion, RollerMotion, RollerMotion]
    _forces: NeedleForces
    _move: bool
    _records: NDArray[np.void]  # of every needle of the last point, shape (trunnion, needle, 2 x sample), or empty

    @classmethod
    def of(
        cls,
        points: JointValues[FloatArray],
        table: FloatArray,
        skews: FloatArray,
        samples: int,
        move: bool,
        record: bool = False,
    ) -> Followers:
        """Needles at their initial skews, shape (point, trunnion), which they keep unless they may `move`.

        `table` is from `needle_constants`; with `record` every needle is recorded.
        """
        recorded = (3, int(points.needle_count.max()), 2 * samples) if record else (3, 0, 0)
        slide = (points.needle_sliding_friction > 0) & (points.speed > 0) & (points.joint_angle > 0)
        over_time = np.repeat(skews[:, :, None], int(points.cycles[0]) * samples, axis=2)
        ring = NeedleMemory.for_samples(samples)
        first, second, third = (ring.of_roller(k, samples) for k in range(3))
        forces = NeedleForces(ring.forces, ring.moments, ring.places)
        settled = np.ones(slide.size, bool)
        return cls(
            slide,
            over_time,
            settled,
            points.groove_load,
            table,
            skews,
            ring,
            (first, second, third),
            forces,
            move,
            np.zeros(recorded, RECORD),
        )

    def follow(self, row: FloatArray, memory: Memory, i: int) -> None:
        """Move the needles of point i along the settled balance, and add their effects to it.

        `row` holds its constants; its tilt is replaced by the motion's. The kernels are called one by one: in
        a common one they would all be compiled once more.
        """
        ring, table = self._memory, self._table[i]
        _read_motions(row, memory, ring)
        tilt = self._tilt(self._loads[i], NeedleConstants._make(table))
        row[TILT] = PointConstants._make(row).roller_radius * tilt
        if not self._move:
            ring.places[:] = 0.0
            for k in range(3):
                _add_swing(row, memory, k, ring.held[k].reshape(-1), ring.places)
            return
        for k, roller in enumerate(self._rollers):
            skew = follow_roller(
                table,
                self._initial[i, k],
                tilt,
                roller,
                ring.needles,
                ring.contacts,
                self._forces,
                self.skews[i, k],
                self._records[k],
            )
            _add_needles(row, memory, ring, k, skew)

    def recorded(self, i: int) -> NDArray[np.void] | None:
        """Every needle of point i, which was followed last; None where its needles do not move."""
        if not (self._records.size and self._move and self.slide[i] and self.settled[i]):
            return None
        return self._records[:, : int(NeedleConstants._make(self._table[i]).needles)]

    def _tilt(self, load: float, c: NeedleConstants) -> float:
        """Tilt k_t for the load's largest distance from the middle of the needles in the motions that were read."""
        offsets = max(np.abs(roller.offsets).max() for roller in self._rollers)
        farthest = min(max(offsets, 0.01 * c.length), FARTHEST * c.length)
        crown = 0.25 * c.drop * c.length * c.length
        needles = NeedleRow(c.clearance, c.stiffness, c.needles, c.length, c.spheres, crown)
        tilt: float = turned_bearing(load, farthest, 0.0, needles)[2] / farthest
        return tilt

    def keep(self, i: int) -> None:
        """Let the needles of point i keep their skew."""
        self.skews[i], self.settled[i] = self._initial[i, :, None], False
