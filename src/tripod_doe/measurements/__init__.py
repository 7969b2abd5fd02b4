"""Records of a rig: read as recorders write them, put over the rotation angle, tracked by orders."""
