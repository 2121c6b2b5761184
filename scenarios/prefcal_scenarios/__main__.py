"""`python -m prefcal_scenarios` is `prefcal`."""

from prefcal_scenarios.cli import main

if __name__ == "__main__":
    main()
