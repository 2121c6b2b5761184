"""`prefcal new`: starters for scenarios of people's own."""
