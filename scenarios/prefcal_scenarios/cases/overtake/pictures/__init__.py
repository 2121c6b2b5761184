"""Figures and animations of the overtaking."""
