"""The end of a benchmark, for people."""

from pathlib import Path

from rich.console import Console
from rich.text import Text

from prefcal_scenarios.bench import Finished
from prefcal_scenarios.bench.results import print_table
from prefcal_scenarios.report.wording import printable


def show(finished: Finished, page: Path, console: Console) -> None:
    """Print the tables, what failed, the digest, and where the page is."""
    print_table(console, finished.results, finished.duels)
    for words in finished.trouble:
        console.print(Text(printable(words), style="red"), soft_wrap=True)
    console.print(Text.assemble("Digest: ", (finished.digest, "bold")), soft_wrap=True)
    console.print(Text.assemble("Page: ", (str(page), "bold")), soft_wrap=True)
