"""Run `prefcal` as `python -m prefcal_scenarios`."""

from prefcal_scenarios.app.cli import main

if __name__ == "__main__":
    main()
