"""What is said of a result stands on the page, on the sheet and in the report: at the end, and ever after."""

import html
import json
import re
import threading
from pathlib import Path

import pytest

from prefcal_agents.screening import findings
from prefcal_app.session import Choice, Phase, actions
from prefcal_app.view import now_view
from support import unseen as unseen_module
from support.closing import AnsweringPage
from support.screened import let_say

UNSEEN = f"{unseen_module.__file__}:unseen"
STUDY = ("calibrate", UNSEEN, "--simulate", "40", "--n-max", "4", "--study", "mine", "--out", "out")
UNTOLD = "It is the best by the answers, each of which is in comparisons.csv."
AGAIN = ("report", "mine", "--scenario", UNSEEN, "--out", "out")
FILES = ("report.html", "acceptance.html", "best.json")


def answers(folder=Path("out")):
    """What the sheet answers about the result: what is left to gain, and why this one."""
    text = html.unescape(re.sub(r"<[^>]+>", " ", (folder / "acceptance.html").read_text(encoding="utf-8")))
    left, why = re.search(r"Left to gain(.*?)Why this one(.*?)The controller", text, re.DOTALL).groups()
    return " ".join(left.split()), " ".join(why.split())


@pytest.fixture(autouse=True)
def explained(monkeypatch):
    """Let the KPIs explain the few answers."""
    let_say(monkeypatch, certificate=None)


def test_a_report_that_is_written_again_says_what_was_said_at_the_end(prefcal, tmp_path):
    code, out, err = prefcal(*STUDY, "--calibrator", "synthetic")
    assert code == 0, err
    assert "Not verified on other plants than the modeled one: run prefcal verify out/best.json." in out
    left, why = answers()
    assert left.split(" A weighted sum")[0] in out  # the sheet says how sure that is, too
    assert "simulated is better than the best so far" in left
    assert re.split(r"(?<=\.) (?=[A-Z])", why)[0] in out
    assert why != UNTOLD
    written = {name: (tmp_path / "out" / name).read_bytes() for name in FILES}
    code, again, err = prefcal(*AGAIN)
    assert code == 0, err
    assert {name: (tmp_path / "out" / name).read_bytes() for name in FILES} == written
    assert again == out


class Page(AnsweringPage):
    """In place of the window: a person who answers, sees the report, and closes the page."""

    first, last = threading.Event(), None

    def wait(self, timeout):
        self.turn += 1
        if self.turn == 1:
            self.answer()
        if self.turn == 3:  # the report is there, and not all is said
            Page.early = answers(), json.loads(Path("out", "best.json").read_bytes())
            Page.first.set()
            if self.last == "later":
                assert self.interview.known.wait_for_findings(60.0)
        if self.turn == 5:
            Page.late = answers()
        return self.turn == {"at once": 3, "later": 5}[self.last]


@pytest.mark.parametrize("last", ["at once", "later"])
def test_what_takes_longer_than_people_wait_is_added_to_the_report(prefcal, monkeypatch, last):
    carried = findings._explain_result
    monkeypatch.setattr(Page, "first", threading.Event())
    monkeypatch.setattr(Page, "last", last)
    monkeypatch.setattr("prefcal_app.cli.calibrate.SAID_SOON", 0.1)

    def slowly(agent, known):
        if known.over:
            assert Page.first.wait(60.0)
        return carried(agent, known)

    monkeypatch.setattr("prefcal_app.web.Window", Page)
    monkeypatch.setattr(findings, "_explain_result", slowly)
    code, out, err = prefcal(*STUDY, "--no-browser")
    assert code == 0, err
    (_, early), best = Page.early
    _, late = answers()
    assert early == UNTOLD
    assert late != early
    assert late.split(".")[0] in out
    assert out.count("Report: ") == 1
    assert last == "at once" or Page.late[1] == late, "written before the page was closed"
    assert json.loads(Path("out", "best.json").read_bytes()) == best, "a verification of it still counts"
    prefcal(*AGAIN)
    assert answers()[1] == late


def test_a_page_that_is_opened_again_shows_what_was_said(tmp_path):
    from support.interviews import reopened, worked
    from support.screened import explained, screening, simulated

    interview = explained(screening(n_max=4, path=tmp_path / "a.prefcal"))
    while interview.now().phase is not Phase.OVER:
        interview.do(actions.Answer(interview.now().question.id, Choice.LEFT))
        worked(interview)
    said, over = interview.known.findings, now_view(interview)["over"]
    outlook = interview.known.outlook
    assert said.complete
    interview.file.close()
    again = reopened(simulated, tmp_path / "a.prefcal")
    assert (again.known.findings, again.known.outlook) == (said, outlook), "before anything is simulated"
    events = len(list(again.file.events()))
    worked(again)
    assert again.known.findings == said
    assert now_view(again)["over"] == over
    assert len(list(again.file.events())) == events, "it is kept once"
    again.do(actions.Retract(1))
    assert again.now().state.concluded is None, "it was true of another record"
    worked(again)
    assert again.now().state.concluded is not None
