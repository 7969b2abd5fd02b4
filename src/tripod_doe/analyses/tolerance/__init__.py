"""Distribution of outputs under manufacturing scatter, and gain by tighter tolerances."""
