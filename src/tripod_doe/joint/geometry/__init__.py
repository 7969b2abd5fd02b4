"""Consequences of the dimensions alone: kinematics, contact stiffness, inertia, transition velocities, feasibility."""
