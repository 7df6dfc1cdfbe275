"""Colours of pictures, pages and the view."""

from __future__ import annotations

INK, MUTED, FAINT = "#1f2937", "#6b7280", "#e5e7eb"
LEFT, RIGHT, MIDDLE = "#0072b2", "#d55e00", "#00795c"
"""Left, right, and what has no side; told apart with any colour vision (after Okabe and Ito, 2008)."""
HUMAN, WARN = "#9b59b6", "#c0392b"
