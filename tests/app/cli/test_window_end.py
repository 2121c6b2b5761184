"""What a person chooses on the page of a finished study is what the command writes."""

import json

import numpy as np
import pytest

from prefcal_app.session import Phase, actions
from support.closing import AnsweringPage

SCREENED = (
    "calibrate",
    "servo",
    "--simulate",
    "60",
    "--n-max",
    "3",
    "--no-browser",
    "--study",
    "s",
    "--out",
    "o",
)
WANTED = 20
"""Number of a simulated θ that nobody was shown."""


class Page(AnsweringPage):
    """In place of the window: it answers, and then chooses while the command looks away."""

    chosen = None

    def wait(self, timeout):
        self.turn += 1
        steps = {1: self.answer, 3: self.choose}
        steps.get(self.turn, lambda: None)()
        return self.turn == self.last

    def choose(self):
        assert self.interview.known.wait_for_findings(60.0)
        theta = np.array(self.interview.known.screened().bank.thetas[WANTED])
        self.interview.look_at(theta)
        self.interview.do(actions.Choose(theta, self.interview.now().incumbent))
        Page.chosen = self.until(lambda now: now.phase is Phase.OVER).incumbent


@pytest.mark.parametrize("last", [3, 5], ids=["closed at once", "closed later"])
def test_a_choice_at_the_end_is_what_is_written(prefcal, monkeypatch, tmp_path, last):
    monkeypatch.setattr("prefcal_app.web.Window", Page)
    monkeypatch.setattr(Page, "last", last, raising=False)
    code, _, err = prefcal(*SCREENED)
    assert code == 0, err
    best = json.loads((tmp_path / "o" / "best.json").read_text("utf-8"))
    assert best["experiment"] == Page.chosen + 1
    assert json.loads(prefcal("studies", "show", "s", "--json")[1])["best"] == best["theta"]
