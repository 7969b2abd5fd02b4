"""The models of the joint: what each is, what it costs and how its blocks of points are simulated."""
