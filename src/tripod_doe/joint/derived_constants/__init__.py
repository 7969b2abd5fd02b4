"""Constants of a joint from its dimensions and material: contact stiffnesses and pressure, load zone, inertia."""
