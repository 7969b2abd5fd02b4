"""The law of the needles for the balances: their motion, and the tilt they allow. As bodies they are in `multibody`."""
