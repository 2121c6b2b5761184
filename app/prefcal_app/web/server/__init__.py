"""Serve the query window: socket, security, static files."""
