"""The command `prefcal bench`."""
