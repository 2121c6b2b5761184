"""Optional worlds: what prefcal can do with other software, each in a module of its own."""
