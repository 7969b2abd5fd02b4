"""Questions to a cube: which cells are chosen, and what is shown of them. Analyses are no part of it."""
