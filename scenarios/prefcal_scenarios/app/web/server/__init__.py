"""The server of the query window: binding, security, static files."""
