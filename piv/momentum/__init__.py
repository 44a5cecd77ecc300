"""From accelerations of the water to its pressure, and to its loads on moving bodies."""
