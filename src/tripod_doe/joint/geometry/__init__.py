"""Consequences of the dimensions alone: kinematics, overlaps, transition velocities, feasibility."""
