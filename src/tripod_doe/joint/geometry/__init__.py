"""What follows from dimensions alone: kinematics, contact stiffness, inertia, transition velocities, feasibility."""
