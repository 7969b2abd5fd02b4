"""Forces of elements with their derivatives, inertia and constraints, as loops over tables. Laws are in `laws`."""
