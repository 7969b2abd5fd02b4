"""Correction of the `kinetostatic` balance by needles that follow its rollers.

The balance treats all needles of a trunnion as one needle with one skew and equal slip on trunnion and bore.
`needle_motion` moves every needle along the motion of the balance; the difference of its forces from that law is added
to the balance at every sample, which is then solved again.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tripod_doe.array_types import FloatArray, IntArray
from tripod_doe.joint.force_balance.added_motion import added_motion
from tripod_doe.joint.force_balance.point_constants import TILT, PointConstants, flank, point_constants_of
from tripod_doe.joint.force_balance.roller_forces import leaning_contact
from tripod_doe.joint.force_balance.samples import Memory, motion_at
from tripod_doe.joint.massless_needles.bearing_tilt import NeedleRow, turned_bearing
from tripod_doe.joint.massless_needles.load_along_needle import FARTHEST
from tripod_doe.joint.massless_needles.load_sharing import NeedleLoads, NeedleSteps, RollerMotions, press_needles
from tripod_doe.joint.massless_needles.needle_constants import NeedleConstants
from tripod_doe.joint.massless_needles.needle_history import NeedleForces, follow_rollers
from tripod_doe.joint.massless_needles.needle_motion import RECORD, NeedleRing
from tripod_doe.joint.values import JointValues
from tripod_doe.mechanics.arithmetic.simd_lanes import WIDTH, load, spread, store
from tripod_doe.mechanics.compilation.by_reference import ByReference
from tripod_doe.mechanics.compilation.kernels import inlined_kernel, kernel, kernel_part
from tripod_doe.mechanics.laws.needles import needle_grip, needle_slip


@dataclass(frozen=True, eq=False)
class NeedleMemory(ByReference):
    """Memory of the kernels while needles follow the rollers of a point."""

    motions: RollerMotions
    held: FloatArray  # force of needles that keep their skew along every trunnion, over N, shape (3, eights, 8)
    steps: NeedleSteps
    forces: NeedleForces
    blocks: IntArray  # of eight loaded needles in the motion that was read, shape (1,)

    @classmethod
    def for_samples(cls, samples: int, revolutions: int) -> NeedleMemory:
        """Memory for a number of samples per revolution, and a number of revolutions with separate forces."""
        motions = RollerMotions.for_samples(samples)
        forces = NeedleForces.of_last(revolutions, samples)
        return cls(
            motions, np.zeros_like(motions.spins), NeedleSteps.for_samples(samples), forces, np.zeros(1, np.int64)
        )


@kernel
def _read_motions(row, memory, ring):
    """Read the motion of every roller on its trunnion from the balance."""
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


@inlined_kernel
def _mean(pair, at):
    """Mean of two revolutions at a sample."""
    return 0.5 * (pair[0][at] + pair[1][at])


@kernel_part
def _add_forces(row, memory, ring, k, revolutions):
    """Add the difference of the needle forces of trunnion k from the law of the balance, which uses their mean skew."""
    p, samples, (one, other) = point_constants_of(row), memory.samples, revolutions
    skew = _mean((ring.forces.skews[one], ring.forces.skews[other]), k)
    forces = ring.forces.forces[one, k], ring.forces.forces[other, k]
    moments = ring.forces.moments[one, k], ring.forces.moments[other, k]
    cosine, sine = math.cos(skew), math.sin(skew)
    memory.turns[k, 0], memory.turns[k, 1] = cosine, sine
    for j in range(WIDTH * memory.eights.shape[1]):
        at = j if j < samples else j - samples
        e, i = memory.eights[k, j // WIDTH], j % WIDTH
        b, lane = at // WIDTH, at % WIDTH
        plunge, spin = ring.motions.plunges[k, b, lane], ring.motions.spins[k, b, lane]
        slip = needle_slip(plunge, spin, p.needle_lever, (cosine, sine))
        drag = p.needle_friction * needle_grip(slip, p.needle_transition)
        e.needle_force[0, i] = _mean(forces, at) + drag * cosine
        e.needle_moment[0, i] = _mean(moments, at) - drag * p.needle_lever * sine


@kernel_part
def _add_swing(row, memory, k, forces, places):
    """Add the swing of roller k that is missing in the tilt of the balance.

    Its needles' friction acts at their pitch circle, not at the groove, and their middle moves. `forces` and `places`
    along the trunnion are those of two revolutions, shape (sample,) each, whose mean counts.
    """
    p, samples = point_constants_of(row), memory.samples
    shorter = p.roller_radius - p.bearing_radius
    for j in range(WIDTH * memory.eights.shape[1]):
        at = j if j < samples else j - samples
        before, after = at - 1 if at > 0 else samples - 1, at + 1 if at < samples - 1 else 0
        nearer = shorter * (_mean(forces, after) - _mean(forces, before)) + _mean(places, after) - _mean(places, before)
        memory.eights[k, j // WIDTH].needle_swing[0, j % WIDTH] = -0.5 * p.pace * p.tilt * nearer


@kernel
def _add_needles(row, memory, ring, one, other):
    """Add the effects of the needles of all trunnions to the balance: the mean of two revolutions."""
    for k in range(3):
        _add_forces(row, memory, ring, k, (one, other))
        of = ring.forces
        _add_swing(row, memory, k, (of.forces[one, k], of.forces[other, k]), (of.places[one, k], of.places[other, k]))


@dataclass(frozen=True)
class Followers:
    """Needles of a block of points."""

    slide: NDArray[np.bool_]  # whether the needles of a point slide, and the joint is bent and turns; shape (point,)
    # of the needle that carries the most, rad, over all revolutions, shape (point, trunnion, cycles sample)
    skews: FloatArray
    settled: NDArray[np.bool_]  # whether the balance converged with moving needles, shape (point,)
    revolutions: int  # last revolutions with separate results
    _loads: FloatArray  # mean normal force at a groove, shape (point,)
    _table: FloatArray
    _initial: FloatArray
    _memory: NeedleMemory
    # memory by blocks of eight needles that carry, and by steps of a revolution
    _carrying: dict[tuple[int, int], tuple[NeedleLoads, NeedleRing]]
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
        revolutions: int = 2,
        record: bool = False,
    ) -> Followers:
        """Needles at their initial skews, shape (point, trunnion), which stay constant unless needles `move`.

        `table` is from `needle_constants`; with `record` every needle is recorded.
        """
        records = np.zeros((3, 2 * samples, int(points.needle_count.max())) if record else (3, 0, 0), RECORD)
        slide = (points.needle_sliding_friction > 0) & (points.speed > 0) & (points.joint_angle > 0)
        over_time = np.repeat(skews[:, :, None], int(points.cycles[0]) * samples, axis=2)
        ring = NeedleMemory.for_samples(samples, revolutions)
        settled = np.ones(slide.size, bool)
        known = points.groove_load, table, skews
        return cls(slide, over_time, settled, revolutions, *known, ring, {}, move, records)

    def follow(self, row: FloatArray, memory: Memory, i: int) -> None:
        """Move the needles of point i along the settled balance, and add their effects to it.

        `row` holds its constants; its tilt is replaced by the motion's. The kernels are called separately: a common
        kernel would compile all of them again.
        """
        ring, table = self._memory, self._table[i]
        _read_motions(row, memory, ring)
        tilt = self._tilt(self._loads[i], NeedleConstants._make(table))
        row[TILT] = PointConstants._make(row).roller_radius * tilt
        if not self._move:
            ring.forces.places[:] = 0.0
            for k in range(3):
                held, place = ring.held[k].reshape(-1), ring.forces.places[0, k]
                _add_swing(row, memory, k, (held, held), (place, place))
            return
        self._press(ring.steps, table)
        self._turn(i, tilt, table, self.skews[i], ring.steps)
        _add_needles(row, memory, ring, self.revolutions - 2, self.revolutions - 1)

    def add(self, row: FloatArray, memory: Memory, revolution: int) -> None:
        """Add the effects of the last followed needles in one of their last revolutions."""
        _add_needles(row, memory, self._memory, revolution, revolution)

    def follow_on(self, row: FloatArray, memory: Memory, i: int) -> None:
        """As `follow` along the same motion, until needles repeat."""
        table = np.array(NeedleConstants._make(self._table[i])._replace(settles=1.0))
        self._follow_again(row, memory, i, table, self._memory.steps)

    def follow_in_half_steps(self, row: FloatArray, memory: Memory, i: int) -> None:
        """As `follow` along the same motion, in steps of half the size."""
        steps, table = NeedleSteps.for_samples(self._memory.motions.samples, finer=2), self._table[i]
        self._press(steps, table)
        self._follow_again(row, memory, i, table, steps)

    def _follow_again(self, row: FloatArray, memory: Memory, i: int, table: FloatArray, steps: NeedleSteps) -> None:
        self._turn(i, row[TILT] / PointConstants._make(row).roller_radius, table, self.skews[i].copy(), steps)
        _add_needles(row, memory, self._memory, self.revolutions - 2, self.revolutions - 1)

    def _press(self, steps: NeedleSteps, table: FloatArray) -> None:
        """Compute the shifts of the rollers at these steps of the motion."""
        self._memory.blocks[0] = -(-press_needles(table, self._memory.motions, steps) // WIDTH)

    def _turn(self, i: int, tilt: float, table: FloatArray, skews: FloatArray, steps: NeedleSteps) -> None:
        """Move the needles of point i along the motion that was read."""
        size = int(self._memory.blocks[0]), steps.steps
        if size not in self._carrying:
            self._carrying[size] = NeedleLoads.for_blocks(*size), NeedleRing.for_blocks(size[0])
        needles, forces = self._carrying[size], self._memory.forces
        follow_rollers(table, self._initial[i], tilt, steps, *needles, forces, skews, self._records)

    def moves(self, i: int) -> bool:
        """Whether the needles of point i moved."""
        return bool(self._move and self.slide[i] and self.settled[i])

    def settles(self, i: int) -> bool:
        """Whether the needles of point i are always followed until their motion repeats."""
        return NeedleConstants._make(self._table[i]).settles > 0

    @property
    def repeat(self) -> bool:
        """Whether the motion of the last followed needles repeats, if they were followed for that."""
        return bool(self._memory.forces.history[1])

    def recorded(self, i: int) -> NDArray[np.void] | None:
        """Records of every needle of point i, the last followed point; None if its needles do not move."""
        if not (self._records.size and self.moves(i)):
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
