"""`python -m prefcal_scenarios` is `prefcal`."""

from prefcal_scenarios.app.cli import main

if __name__ == "__main__":
    main()
