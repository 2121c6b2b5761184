"""The command `prefcal look`."""
