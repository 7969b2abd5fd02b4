"""The region of the factors in which points fail."""
