"""Laws of contact and friction as scalar functions, with equation numbers. Loops over tables are `forces`."""
