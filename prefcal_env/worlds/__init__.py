"""Optional worlds: what prefcal can do with other software; `optional.toml` declares them."""
