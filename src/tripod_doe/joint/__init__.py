"""The tripod constant velocity joint: parameters, contact constants, kinematics, rotating orders and models."""
