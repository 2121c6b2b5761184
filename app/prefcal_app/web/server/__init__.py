"""Serve the query window: binding, security, static files."""
