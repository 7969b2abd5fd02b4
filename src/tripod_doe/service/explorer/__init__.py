"""The cube explorer: views of a cube, the slices and figures that they show, and what can be copied from them."""
