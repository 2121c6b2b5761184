"""Scenarios of optional worlds, each in a module of its own."""
