r"""The thrust split into contributions of the friction mechanisms at the grooves, from the balance of each roller.

A groove is a cylinder along the housing: its normal force has no axial part, so all thrust is sliding friction f of the
rollers: the force itself names one mechanism only. Its direction shows the cause. With n the normal at the contact, h
the roller's own axis through its centre and l = R_s h x n,

    f = f_l l / |l| + f_s s,        s across l in the tangent plane:

l is the way the roller rolls, s is the rest. Across its rolling direction the roller slides because it is led along the
groove and not where it rolls ("disagreement between the rolling and traveling directions", paper 3.5): the axial part
of -f_s s is the share of the groove's sliding. Along l it could roll freely; the friction there follows from the
roller's balance of moments about h,

    f l = M_spinning + M_rolling + M_needle sliding + M_needle rolling - dL / dt,

each divided among the mechanisms by its moment: a moment M adds -M l_z / |l|^2 to the thrust. These parts add up to the
thrust at every instant, for any coefficients and any regularisation. The axis h is the one about which the needles'
normal forces have no moment (the bore is a cylinder about it); L = I h w is the roller's spin.

Needles that roll pass their rolling resistance on by a friction force on the bore, so the moments of the needles are
virtual powers: those of their friction on roller and needles while the roller turns by one radian on its trunnion and
the needles roll along, not slipping across their axes and keeping their skew. In that motion no normal force does work
but for the bearing's clearance, and a lumped bearing's levers come out as r_p and r_e sin psi (`equilibrium`).

The split is a definition, not a law. Friction is one vector of saturated size: friction along l reduces friction across
it, so the sliding part contains the influence of other mechanisms on |f|; an ablation would assign this influence to
them.

Of rollers and lumped bearings all moments are read off the states, and the remainder is what is left: the rollers'
inertia and what a finite step leaves. Of single needles it cannot be so: they rattle, and the forces of a state, whose
equations are solved as closely as the thrust needs it, are not those that moved them. With a tolerance of 2e-3 their
sampled sliding friction misses all of the second order, with 4e-4 3 % of it (paper's case 2). The spin of the rollers
contains all impulses of the needles, so the remainder is the inertia from the spin, and the rest of the balance is the
needles' sliding friction, including neighbours and stops: 106 % and 105 % of the second order with these tolerances.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tripod_doe.array_types import FloatArray
from tripod_doe.joint.multibody.thrust_and_power import ring, turned
from tripod_doe.joint.outputs import PARTS
from tripod_doe.joint.values import JointValues
from tripod_doe.mechanics.arithmetic.simd_lanes import clear
from tripod_doe.mechanics.assembly import Assembly
from tripod_doe.mechanics.compilation.kernels import kernel
from tripod_doe.mechanics.forces.bearing import bearing_forces
from tripod_doe.mechanics.forces.sphere_contact import add_contacts
from tripod_doe.mechanics.tables import FIRST, Slopes

_Z = np.array([0.0, 0.0, 1.0])
_LAWS = ("sliding", "spinning", "rolling")
_TINY = 1e-300


@kernel
def _forces(tables, work, positions, velocities, forces):
    """Forces and moments of contacts and bearings on all bodies, shape (sample, body, 6)."""
    for s in range(positions.shape[0]):
        clear(work.force)
        slopes, count = Slopes(1.0, 0.0, 0.0), tables.contacts.size
        add_contacts(tables, work, FIRST, count, positions[s], velocities[s], slopes, work.matrix)
        bearing_forces(tables.bearings, positions[s], velocities[s], work.force, work.ledger)
        for i in range(forces.shape[1]):
            for d in range(6):
                forces[s, i, d] = work.force[i, d]


def element_forces(
    assembly: Assembly, table: NDArray[np.void], positions: FloatArray, velocities: FloatArray
) -> FloatArray:
    """Forces and moments of some contacts or bearings on all bodies, shape (sample, body, 6); states as in a run."""
    contacts, bearings = assembly.tables.contacts[:0], assembly.tables.bearings[:0]
    if table.dtype == contacts.dtype:
        contacts = table
    else:
        bearings = table
    forces = np.empty_like(velocities)
    tables = replace(assembly.tables, contacts=contacts, bearings=bearings)
    _forces(tables, assembly.memory, positions, velocities, forces)
    return forces


class _Elements:
    """Contacts or bearings in all states of a run: contributions of each friction law beyond the normal forces."""

    def __init__(self, assembly: Assembly, positions: FloatArray, velocities: FloatArray):
        self._assembly, self._states = assembly, (positions, velocities)
        self._normal: dict[bytes, FloatArray] = {}

    def _forces(self, table: NDArray[np.void]) -> FloatArray:
        return element_forces(self._assembly, table, *self._states)

    def normal(self, table: NDArray[np.void]) -> FloatArray:
        """Forces and moments without friction, shape (sample, body, 6); kept, as several laws start from them."""
        table = _with_law(table, "")
        key = table.tobytes()
        if key not in self._normal:
            self._normal[key] = self._forces(table)
        return self._normal[key]

    def of_law(self, table: NDArray[np.void], law: str) -> FloatArray:
        """Forces and moments of one law, which are linear in its coefficient alone, shape (sample, body, 6)."""
        acting = table[table[law] != 0]
        if acting.size == 0:
            return np.zeros_like(self._states[1])
        return self._forces(_with_law(acting, law)) - self.normal(acting)


def _with_law(table: NDArray[np.void], law: str) -> NDArray[np.void]:
    """The elements with the friction of one law, or of none."""
    only = table.copy()
    for name in _LAWS:
        if name != law and name in (table.dtype.names or ()):
            only[name] = 0.0
    return only


def _rolling(assembly: Assembly, positions: FloatArray, values: JointValues[float]) -> FloatArray:
    """Velocities of all bodies while each roller turns at unit rate and its needles roll along: (sample, body, 6)."""
    needle, trunnion, bore = values.needle_radius, values.trunnion_radius, values.bore_radius
    orbit, motion = bore / (bore + trunnion), np.zeros((*positions.shape[:2], 6))
    for k in range(3):
        roller = assembly.names.index(f"roller {k + 1}")
        motion[:, roller, 3:] = turned(positions[:, roller, 3:], _Z)
        if f"needle {k + 1}.1" in assembly.names:
            needles, axis, arms = ring(assembly, positions, values, k)
            own = turned(needles[..., 3:], _Z)
            spin = trunnion / needle * (own * axis).sum(-1, keepdims=True)
            first = assembly.names.index(f"needle {k + 1}.1")
            moving = motion[:, first : first + needles.shape[1]]
            moving[..., :3], moving[..., 3:] = orbit * np.cross(axis, arms), orbit * (axis + spin * own)
    return motion


def _of_each_roller(assembly: Assembly, powers: FloatArray) -> FloatArray:
    """Sums over each roller and its needles of what belongs to bodies, (sample, body) -> (groove, sample)."""
    of = [[f"roller {k}" == name or name.startswith(f"needle {k}.") for name in assembly.names] for k in (1, 2, 3)]
    summed: FloatArray = np.array(of, float) @ powers.T
    return summed


def thrust_parts(
    assembly: Assembly, times: FloatArray, positions: FloatArray, velocities: FloatArray, values: JointValues[float]
) -> FloatArray:
    """Split the thrust at each groove by mechanism; the definition is in the module's documentation.

    Args:
        times, positions, velocities: States of a run at equal distances, shapes (sample,), (sample, body, 7) and
            (sample, body, 6).

    Returns:
        Axial force on the housing in N, shape (part, groove, sample), parts in the order of `outputs.PARTS`; their sum
        is the thrust at the groove (`readings.groove_readings`). A roller that does not touch its groove has zeros.
    """
    rollers = [assembly.names.index(f"roller {k}") for k in (1, 2, 3)]
    tables, elements = assembly.tables, _Elements(assembly, positions, velocities)
    grooves = tables.contacts[-3:]
    needles = tables.bearings if tables.bearings.size else tables.contacts[:-3]
    rolling = _rolling(assembly, positions, values)
    axis, normal = rolling[:, rollers, 3:], elements.normal(grooves)[:, rollers, :3]
    normal = normal / np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), _TINY)
    lever = values.roller_radius * np.cross(axis, normal)
    friction = elements.of_law(grooves, "sliding")[:, rollers, :3]
    gain = -(lever[..., 2] / np.maximum((lever**2).sum(-1), _TINY)).T  # axial force by a moment about the roller's axis

    def part(table: NDArray[np.void], law: str) -> FloatArray:
        powers = np.einsum("sbd,sbd->sb", elements.of_law(table, law), rolling)
        moved: FloatArray = gain * _of_each_roller(assembly, powers)
        return moved

    along = gain * (friction * lever).sum(-1).T
    parts = np.empty((len(PARTS), *gain.shape))
    parts[0] = -friction[..., 2].T - along
    parts[1], parts[2] = part(grooves, "spinning"), part(grooves, "rolling")
    parts[4] = part(needles, "rolling")
    if tables.bearings.size:
        parts[3] = part(needles, "sliding")
        parts[5] = along - parts[1:5].sum(0)
    else:
        spin = (axis * (velocities[:, rollers, 3:] + tables.frame)).sum(-1)
        inertia = tables.bodies["inertia"][rollers, 2]
        parts[5] = -gain * (inertia * np.gradient(spin, times, axis=0)).T
        parts[3] = along - parts[1] - parts[2] - parts[4] - parts[5]
    return parts
