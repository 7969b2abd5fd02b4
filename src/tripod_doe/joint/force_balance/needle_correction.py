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
from tripod_doe.joint.needles.needle_contact import FARTHEST
from tripod_doe.joint.needles.needle_loads import NeedleLoads, NeedleSteps, RollerMotions, press_needles
from tripod_doe.joint.needles.needle_motion import RECORD, NeedleForces, NeedleRing, follow_rollers
from tripod_doe.joint.values import JointValues
from tripod_doe.mechanics.arithmetic.lanes import WIDTH, load, spread, store
from tripod_doe.mechanics.compilation.by_reference import ByReference
from tripod_doe.mechanics.compilation.kernels import kernel, kernel_part
from tripod_doe.mechanics.laws.needles import needle_grip, needle_slip


@dataclass(frozen=True, eq=False)
class NeedleMemory(ByReference):
    """Memory of the kernels while needles follow the rollers of a point."""

    motions: RollerMotions
    held: FloatArray  # force of needles that keep their skew along every trunnion, over N, shape (3, eights, 8)
    steps: NeedleSteps
    forces: NeedleForces

    @classmethod
    def for_samples(cls, samples: int) -> NeedleMemory:
        """Memory for a number of samples per revolution."""
        motions = RollerMotions.for_samples(samples)
        per_sample = np.zeros((3, 3, samples))
        forces = NeedleForces(per_sample[0], per_sample[1], per_sample[2], np.zeros(3))
        return cls(motions, np.zeros_like(motions.spins), NeedleSteps.for_samples(samples), forces)


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
            store(ring.motions.spins[k], b, spin)
            store(ring.motions.plunges[k], b, plunge)
            store(ring.motions.turns[k], b, m.w_r * m.t_r + m.w_t * m.t_t + m.w_z * m.t_z)
            store(ring.motions.yaws[k], b, flank(p) * load(e.steering, 0))
            store(ring.motions.loads[k], b, load(e.normal, 0))
            store(ring.held[k], b, force)
            off = off + p.roller_radius * lean - (p.roller_radius - p.bearing_radius) * force
            store(ring.motions.offsets[k], b, off)


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
        plunge, spin = ring.motions.plunges[k, b, lane], ring.motions.spins[k, b, lane]
        slip = needle_slip(plunge, spin, p.needle_lever, (cosine, sine))
        drag = p.needle_friction * needle_grip(slip, p.needle_transition)
        e.needle_force[0, i] = ring.forces.forces[k, at] + drag * cosine
        e.needle_moment[0, i] = ring.forces.moments[k, at] - drag * p.needle_lever * sine


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
def _add_needles(row, memory, ring):
    """Add the effects of the needles of all trunnions to the balance."""
    for k in range(3):
        _add_forces(row, memory, ring, k, ring.forces.skews[k])
        _add_swing(row, memory, k, ring.forces.forces[k], ring.forces.places[k])


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
    _carrying: dict[int, tuple[NeedleLoads, NeedleRing]]  # memory by blocks of eight needles that carry
    _move: bool
    _records: NDArray[np.void]  # of every needle of the last point, shape (trunnion, 2 x sample, needle), or empty

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
        records = np.zeros((3, 2 * samples, int(points.needle_count.max())) if record else (3, 0, 0), RECORD)
        slide = (points.needle_sliding_friction > 0) & (points.speed > 0) & (points.joint_angle > 0)
        over_time = np.repeat(skews[:, :, None], int(points.cycles[0]) * samples, axis=2)
        ring = NeedleMemory.for_samples(samples)
        settled = np.ones(slide.size, bool)
        return cls(slide, over_time, settled, points.groove_load, table, skews, ring, {}, move, records)

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
            ring.forces.places[:] = 0.0
            for k in range(3):
                _add_swing(row, memory, k, ring.held[k].reshape(-1), ring.forces.places[k])
            return
        blocks = -(-press_needles(table, ring.motions, ring.steps) // WIDTH)
        if blocks not in self._carrying:
            self._carrying[blocks] = NeedleLoads.for_blocks(blocks, ring.steps.steps), NeedleRing.for_blocks(blocks)
        needles = self._carrying[blocks]
        follow_rollers(table, self._initial[i], tilt, ring.steps, *needles, ring.forces, self.skews[i], self._records)
        _add_needles(row, memory, ring)

    def recorded(self, i: int) -> NDArray[np.void] | None:
        """Every needle of point i, which was followed last; None where its needles do not move."""
        if not (self._records.size and self._move and self.slide[i] and self.settled[i]):
            return None
        return self._records[..., : int(NeedleConstants._make(self._table[i]).needles)].swapaxes(1, 2)

    def _tilt(self, load: float, c: NeedleConstants) -> float:
        """Tilt k_t for the load's largest distance from the middle of the needles in the motions that were read."""
        offsets = self._memory.motions.offsets.reshape(3, -1)[:, : self._memory.motions.samples]
        farthest = min(max(np.abs(offsets).max(), 0.01 * c.length), FARTHEST * c.length)
        crown = 0.25 * c.drop * c.length * c.length
        needles = NeedleRow(c.clearance, c.stiffness, c.needles, c.length, c.spheres, crown)
        tilt: float = turned_bearing(load, farthest, 0.0, needles)[2] / farthest
        return tilt

    def keep(self, i: int) -> None:
        """Let the needles of point i keep their skew."""
        self.skews[i], self.settled[i] = self._initial[i, :, None], False
