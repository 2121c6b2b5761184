"""Check that every figure people read first is listed, with how it was measured.

    python benchmarks/release/headlines.py  # list them; exits with 1 if one is missing or outdated

People first read README, the paper, the site's first page, and the first paragraph of other pages.
Each figure there stands in docs/claims.toml with the command that gives it, the revision it was run
at, its seeds, and its interval if it is a mean. A claim about an agent names the version it was
measured with: on the three pages that are read whole, that is the version of today. The studies
behind the worth of an agent on held-out loops are published in held_out.parquet, with a row for
each comparison (docs/own_agent.md), and give the figures again.
"""

import re
import sys
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from statistics import geometric_mean

from rich.console import Console
from rich.table import Table

from prefcal_agents import registry
from prefcal_bench.published import read_curves
from prefcal_bench.results import campaign_of, worth_table

ROOT = Path(__file__).parents[2]
LIST = ROOT / "docs" / "claims.toml"
ROWS = ROOT / "benchmarks" / "release" / "held_out.parquet"
FRONT = ("README.md", "docs/paper/paper.md", "docs/index.md")
"""Pages that are read as a whole; of all others only the first paragraph."""
_OTHERS, _TEN = ("ideal", "majority", "ranks", "curves"), (10, "answers")
_MEAN = "people of another form"
"""The headline of Screening: the geometric mean over tastes whose form it does not have."""
_LEFT_OUT = re.compile(
    r"\A---\n.*?\n---\n"  # front matter
    r"|^```.*?^```"  # code
    r"|`[^`]*`"
    r"|(?<=\])\([^)\s]*\)"  # targets of links
    r"|<[^>]*>"
    r"|\$[^$]*\$"
    r"|@\w+",  # references of the paper
    re.M | re.S,
)
_NO_PROSE = ("#", "!", "<", "|", "{", ":")


@dataclass(frozen=True, slots=True)
class Headline:
    """A figure that people read first."""

    text: str  # the words of the pages, figures included
    pages: tuple[str, ...]  # pages that have them, as paths in the repository
    command: str  # command that gives the figures, or the reason why there is none
    revision: str = ""  # commit at which it ran; empty if any gives the same
    seeds: str = ""  # seeds or repetitions; empty if nothing is random
    interval: str = ""  # 95 % interval, or why there is none; empty if nothing is random
    agent: str = ""  # name and version of the agent, such as "Screening 2"; empty if there is none
    rows: tuple[str, ...] = ()  # which published studies give the figures, such as "weights, 10 answers"

    def faults(self, root: Path = ROOT) -> Iterator[str]:
        """Yield a sentence for each thing that is not as it should be."""
        for page in self.pages:
            if flow(self.text) not in flow(readable(page, root)):
                yield f"{page} no longer says {self.text!r}"
        name, _, version = self.agent.partition(" ")
        for row in self.rows:
            worth = published().get(f"{name}, {row}", "nothing")
            figure, _, interval = worth.partition(" ")
            if figure not in self.text or interval not in self.text + self.interval:
                yield f"{self.text!r}: the published studies give {worth} for {row}"
        if not name or not set(self.pages) & set(FRONT):
            return
        if (now := str(registry.agent_class(name).version)) != version:
            yield f"{self.text!r} is of {self.agent}, now version {now}: measure again, or delete"


@cache
def published() -> dict[str, str]:
    """Return the worth that the published studies give: "684 [555, 838]" for "GLISp, ..."."""
    rows = worth_table(campaign_of((), read_curves(ROWS)), "")
    found = {
        f"{row['agent']}, {row['taste']}, {row['after']} {row['unit']}": (
            f"{row['worth']:.0f} [{row['worth_low']:.0f}, {row['worth_high']:.0f}]"
        )
        for row in rows
    }
    last = [r["worth"] for r in rows if r["taste"] in _OTHERS and (r["after"], r["unit"]) == _TEN]
    return found | {f"Screening, {_MEAN}, 10 answers": f"{geometric_mean(last):.0f}"}


def flow(text: str) -> str:
    """Return `text` with every sequence of white space as one blank."""
    return " ".join(text.split())


def readable(page: str, root: Path = ROOT) -> str:
    """Return what people read first on a page: all of a front page, else the first paragraph."""
    text = _LEFT_OUT.sub("", (root / page).read_text("utf-8"))
    if page in FRONT:
        return text
    blocks = (block.strip() for block in re.split(r"\n\s*\n", text))
    return next((b for b in blocks if b and not b.startswith(_NO_PROSE)), "")


def read(path: Path = LIST) -> tuple[list[Headline], dict[str, list[str]]]:
    """Return the listed figures, and per page the numbers that are no measurements."""
    content = tomllib.loads(path.read_text("utf-8"))
    listed = [Headline(**{**row, "pages": tuple(row["pages"])}) for row in content["claim"]]
    return listed, content["given"]


def unlisted(page: str, listed: list[Headline], given: list[str], root: Path = ROOT) -> str:
    """Return the words around the first figure of a page that is not listed; empty if all are."""
    text = flow(readable(page, root))
    for words in [h.text for h in listed if page in h.pages] + given:
        text = text.replace(flow(words), "")
    found = re.search(r".{0,60}\d.{0,30}", text)
    return found[0] if found else ""


def pages() -> list[str]:
    """Return all pages, as paths in the repository."""
    found = [ROOT / FRONT[0], *sorted((ROOT / "docs").rglob("*.md"))]
    return [page.relative_to(ROOT).as_posix() for page in found]


def faults() -> list[str]:
    """Return a sentence for each claim that is outdated, and each figure that is not listed."""
    listed, given = read()
    found = [fault for headline in listed for fault in headline.faults()]
    for page in pages():
        if words := unlisted(page, listed, given.get(page, []) + given["everywhere"]):
            found.append(f"{page}: no claim for the figure in {words!r}")
    return found


def main() -> int:
    """Print the list and what is wrong with it; return the exit code."""
    table = Table("figure", "seeds", "interval", "agent", "command")
    for row in read()[0]:
        table.add_row(flow(row.text), row.seeds, row.interval, row.agent, row.command)
    console = Console(markup=False)
    console.print(table)
    found = faults()
    for fault in found:
        console.print(fault)
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
