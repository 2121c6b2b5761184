"""The tests of prefcal; those of the benchmark are beside it and have the same plugins."""

pytest_plugins = ["support.parts", "support.session"]
