"""Which figures of worth there are."""

import pytest

from prefcal_bench.results.campaign import campaign_of
from prefcal_bench.results.pictures import Material, draw_loops, draw_overview
from support.worths import study, walks


def shown(results, baseline="GLISp"):
    material = Material(campaign_of(results), baseline=baseline)
    return {one.file: one for one in (*draw_overview(material), *draw_loops(material))}


def test_every_taste_has_figures_by_loop_but_not_those_with_wrong_answers():
    tastes = ("weights", "limits", "weights-noisy10")
    found = shown(walks({"GLISp": 1.2, "Own": 1.0}, ("servo",), tastes, 2, n_max=5))
    assert list(found) == [
        "worth-summary.png", "worth-drift.png", "worth-summary-noisy.png", "worth-drift-noisy.png",
        *(f"worth-{by}-{taste}.png" for taste in tastes[:2]
          for by in ("experiments", "answers")),
    ]  # fmt: skip
    assert all(one.content.startswith(b"\x89PNG") for one in found.values())


def test_without_others_or_answers_there_are_fewer():
    found = shown([study("GLIS", questions=(0, 0))])
    assert list(found) == ["worth-summary.png", "worth-drift.png", "worth-experiments.png"]
    assert shown([]) == {}


def test_alternative_texts_say_what_the_figures_say():
    results = [study(worth=(1, 8, 4)), study("Own", worth=(1, 2, 40))]
    found = shown(results)
    assert "weights: Own 40, GLISp 4.0" in found["worth-summary.png"].alt
    assert "Own 1.0, GLISp 2.0" in found["worth-drift.png"].alt
    assert "servo Own (40)" in found["worth-experiments.png"].alt


@pytest.mark.parametrize("name", [r"a$\frac{.py:A", "_hidden", "x\x1b[2J\ny"])
def test_strange_names_are_drawn_as_they_stand(name):
    assert len(shown([study(name), study("Own")], baseline="Own")) == 4
