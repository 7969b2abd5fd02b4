"""Attributes by which a reader of a cube knows how its variables are stored."""

POINT_ATTRIBUTES = {"long_name": "number of the point in the design", "units": "1"}
"""Attributes of the coordinate ``point`` of a cube, which counts from 0."""

TEXT_TABLE = "text_table"
"""Attribute of a variable of numbers: the name of the variable with the texts to which they refer."""
