"""What a run checks about itself: energy, halved steps, limits of a step, stability. Outcomes are set by `run`."""
