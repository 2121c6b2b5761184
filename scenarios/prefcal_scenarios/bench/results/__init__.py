"""The results of a campaign: tables, figures, and one page that holds both."""

from prefcal_scenarios.bench.results.duelling import duel_table as duel_table
from prefcal_scenarios.bench.results.rows import as_csv as as_csv
from prefcal_scenarios.bench.results.rows import table as table
from prefcal_scenarios.bench.results.terminal import print_table as print_table
from prefcal_scenarios.bench.results.write import write as write

__all__ = ["as_csv", "duel_table", "print_table", "table", "write"]
