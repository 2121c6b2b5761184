"""Run `prefcal`; also as `python -m prefcal_app`."""

import gc
import sys
from io import TextIOWrapper


def main() -> None:
    """Run the command line."""
    # Imports and figures create hundreds of thousands of objects that live on: looking for unused
    # ones among them after every 700 took a tenth of the time of a study, and of `prefcal --help`.
    gc.set_threshold(100_000)
    for stream in (sys.stdout, sys.stderr):
        # cp1252, as in a file on Windows, has no ✓ and no ∞: a question mark ends no command.
        # In the locale C, what is read may pass through, but no other character.
        if isinstance(stream, TextIOWrapper) and stream.errors in ("strict", "surrogateescape"):
            stream.reconfigure(errors="replace")
    from .cli import main as run

    run()


if __name__ == "__main__":
    main()
