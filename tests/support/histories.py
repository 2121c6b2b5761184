"""Samples for histories that are made by hand."""

from prefcal_env.preferences.history import Sample


def in_cube(z):
    """Return a sample of a space in which θ and its point of the cube are the same."""
    point = tuple(map(float, z))
    return Sample(point, point)
