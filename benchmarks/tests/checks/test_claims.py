"""Figures in README and docs: their words are still there, and a wrong one is noticed."""

import importlib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]


@pytest.fixture
def claims(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "benchmarks" / "checks")
    return importlib.import_module("claims")


def test_every_claim_is_still_in_its_page(claims):
    gone = [f"{c.page}: {c.words}" for c in claims.CLAIMS if not c.written()]
    assert gone == []


def test_every_claim_has_a_figure(claims):
    assert all(claim.figures for claim in claims.CLAIMS)


def test_line_breaks_do_not_matter_but_words_do(claims, tmp_path):
    (tmp_path / "page.md").write_text("The index\nis  0.70 here.")
    claim = claims.Claim("page.md", "index is ‹0.70› here", lambda: [0.7])
    assert claim.written(tmp_path)
    assert not claims.Claim("page.md", "index is ‹0.71›", lambda: [0.7]).written(tmp_path)


@pytest.mark.parametrize(
    ("figure", "value", "right"),
    [
        ("0.70", 0.7049, True),
        ("0.70", 0.7051, False),
        ("0.705", 0.7045, True),
        ("3", 3.4, True),
        ("-0.91", -0.9149, True),
        ("-0.91", 0.91, False),
        ("1.0", float("nan"), False),
    ],
)
def test_a_figure_is_right_if_it_is_the_rounded_one(claims, figure, value, right):
    claim = claims.Claim("page.md", f"it is ‹{figure}›", lambda: [value])
    assert (list(claim.wrong()) == []) is right


def test_a_wrong_figure_is_named_with_its_page_and_what_comes_out(claims):
    claim = claims.Claim("page.md", "‹1.5› and ‹2.5› m", lambda: [1.5, 2.7])
    assert list(claim.wrong()) == ["page.md: '1.5 and 2.5 m' says 2.5, now 2.7"]
    (fewer,) = claims.Claim("page.md", "‹1.5› and ‹2.5›", lambda: [1.5]).wrong()
    assert "has 2 figures, got 1" in fewer


def test_one_wrong_figure_ends_with_1(claims, monkeypatch, capsys):
    right = claims.Claim("docs/mpc.md", "the condition is ‹2›", lambda: [2])
    monkeypatch.setattr(claims.Claim, "written", lambda self, root=ROOT: True)
    monkeypatch.setattr("sys.argv", ["claims.py"])
    for computed, code in ((2, 0), (3, 1)):
        claim = claims.Claim(right.page, right.text, lambda computed=computed: [computed])
        monkeypatch.setattr(claims, "CLAIMS", (claim,))
        assert claims.main() == code
    assert "says 2, now 3" in capsys.readouterr().out


def test_ci_checks_the_claims():
    assert "benchmarks/checks/claims.py" in (ROOT / ".ci" / "run").read_text()
