"""Gestures as key poses: their recipes, what is drawn of one, and its strokes over time."""
