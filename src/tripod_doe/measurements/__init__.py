"""Records of a rig: read recorder files, map samples to the rotation angle, track orders."""
