"""Helpers without preference learning: argument checks, threads, optional extras."""
