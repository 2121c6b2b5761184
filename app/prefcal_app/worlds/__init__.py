"""Screens in optional worlds, each in a module of its own."""
