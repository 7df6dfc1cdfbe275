"""Standard acceleration of free fall."""

GRAVITY = 9.81
"""[m/s²], along the world's -z."""
