"""Claims of the paper, checked on cubes."""
