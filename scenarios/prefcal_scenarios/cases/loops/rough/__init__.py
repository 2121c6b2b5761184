"""Rough loops: random ones as they are met in practice, with everything that makes steps."""
