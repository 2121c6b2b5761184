"""Tables of a result in a terminal: nothing is cut, however narrow it is."""

from dataclasses import replace
from io import StringIO
from types import SimpleNamespace

from rich.console import Console

from prefcal_agents.screening.findings import Reason
from prefcal_app.cli.choices import IN_MEMORY
from prefcal_app.cli.options import Options
from prefcal_app.cli.result import _count_held, _draw, _outlook
from prefcal_app.summary import Outlook
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


def test_after_the_last_answer_what_its_question_counted_of_both_runs_is_known():
    def counts(comparisons, kept=87, against=219, theta=(3.0,)):
        reason = None if kept is None else Reason(0.9, (), (), kept, against)
        screened = SimpleNamespace(
            pending=SimpleNamespace(theta=theta), findings=SimpleNamespace(reason=reason)
        )
        samples = [SimpleNamespace(theta=(float(k),)) for k in range(4)]
        state = SimpleNamespace(history=SimpleNamespace(comparisons=comparisons, samples=samples))
        known = SimpleNamespace(screened=lambda *, current: screened)
        return _count_held(SimpleNamespace(known=known, now=lambda: SimpleNamespace(state=state)))

    last = SimpleNamespace(challenger=3, incumbent=2)
    assert counts([last]) == {3: 87, 2: 219}
    assert counts([last], theta=(2.5,)) == {}, "the counts are those of another question"
    assert counts([SimpleNamespace(challenger=3, incumbent=None)], against=None) == {3: 87}
    assert counts([]) == counts([last], kept=None) == {}


def test_where_something_better_may_be_left_the_end_says_how_to_look_for_it():
    options = Options("own.py:tank", study="./mine.prefcal", n_max=11)
    said = Outlook(promise="The chance is 43 %.", ends="b is at the end of its range:", command="respace")

    def more(*, worth=True, ended="all compared", path="mine", candidates=None, of=options, found=said):
        known = SimpleNamespace(outlook=found, worth_going_on=worth, n_max=11)
        scenario = SimpleNamespace(source=SimpleNamespace(candidates=candidates))
        now = SimpleNamespace(state=SimpleNamespace(ended=ended))
        file = SimpleNamespace(path=path)
        return _outlook(SimpleNamespace(known=known, scenario=scenario, now=lambda: now, file=file), of)

    assert more().lines == (
        "The chance is 43 %.",
        "To look for it with 5 more questions, run: prefcal calibrate own.py:tank --study ./mine.prefcal "
        "--n-max 16",
        "b is at the end of its range:",
        "respace",
    )
    program = replace(options, calibrator="synthetic")
    for other in (
        {"worth": False},
        {"ended": ""},
        {"path": IN_MEMORY},
        {"candidates": (1,)},
        {"of": program},
    ):
        assert more(**other) == said, other
    assert more(found=None) is None
