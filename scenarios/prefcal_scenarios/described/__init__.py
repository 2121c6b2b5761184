"""Scenarios described by plain data: a TOML file, an FMU, or a plant with a standard controller."""
