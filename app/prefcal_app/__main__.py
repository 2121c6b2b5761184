"""Run `prefcal`; also as `python -m prefcal_app`."""

import gc


def main() -> None:
    """Run the command line."""
    # Imports and figures create hundreds of thousands of objects that live on: looking for unused
    # ones among them after every 700 took a tenth of the time of a study, and of `prefcal --help`.
    gc.set_threshold(100_000)
    from .cli import main as run

    run()


if __name__ == "__main__":
    main()
