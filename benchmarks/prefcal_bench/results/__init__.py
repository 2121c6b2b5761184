"""Present the results of a campaign: statistics, tables, figures, and one page with all of them.

`results.page.write` makes the page; it is not loaded here, since tables need no plots.

The worth of a θ is how many random experiments it takes on average to find one at least as good,
so higher is better; 1 is the worst.
"""

from .campaign import Campaign as Campaign
from .campaign import campaign_of as campaign_of
from .rows import as_csv as as_csv
from .rows import duel_table as duel_table
from .rows import table as table
from .rows import worth_rows as worth_rows
from .rows import worth_table as worth_table
from .terminal import print_table as print_table
