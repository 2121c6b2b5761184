"""Tables of a result in a terminal: nothing is cut, however narrow it is."""

from io import StringIO

from rich.console import Console

from prefcal_app.cli.result import _draw
from prefcal_app.view.question import cell, row, table


def test_a_table_in_a_terminal_cuts_no_word_and_goes_on_where_there_is_no_room():
    heads = ["", "best", "first experiment", "SIMC without T_d", "Ziegler-Nichols"]
    name, cells = (
        "settling time of temperature (within ±5 %)",
        [cell("8.4", met) for met in (None, True, None, False)],
    )
    shown = table("Result table", heads, [row(name, cells, unit="min"), row("b", cells)])
    for width, tables in ((120, 1), (60, 2), (36, 4)):
        console = Console(width=width, file=StringIO())
        drawn = list(_draw("PID", shown, console))
        console.print(*drawn)
        lines = console.file.getvalue().splitlines()
        said = " ".join(" ".join(lines).split())
        assert len(drawn) == tables
        assert "…" not in said
        assert all(
            said.count(word) == 1 for word in ["PID", "best", "experiment", "without", "Ziegler-Nichols"]
        )
        assert said.count("temperature") == said.count("[min]") == tables
        assert (said.count("8.4 ✓"), said.count("8.4 ✗")) == (2, 2)
        assert max(map(len, lines)) <= width
