"""`prefcal choose`: a table of runs, about ten questions, and the row that the person wants."""

import json
from itertools import count

import numpy as np
import pytest

from prefcal_agents.screening.findings import Reason
from prefcal_app.session import Choice, Phase, actions
from prefcal_app.simulating.why import as_shown, why
from prefcal_env.experiments.experiment import Channels, End, Experiment
from prefcal_scenarios.catalog import load
from support.interviews import until
from support.studies import state_of

ROWS = 60


@pytest.fixture(autouse=True)
def _table(tmp_path):
    (tmp_path / "runs.csv").write_text(table())


def table(rows=ROWS):
    """Runs of a loop: the faster, the more overshoot; the temper of each is anything from 0 to 10."""
    rng = np.random.default_rng(5)
    lines = ["run,K_p [%/m],overshoot [%],settling [s],temper,operator"]
    for k in range(rows):
        gain, temper = rng.uniform(1, 9), rng.uniform(0, 10)
        overshoot, settling = 3 * gain + rng.uniform(0, 5), 60 / gain + rng.uniform(0, 5)
        lines.append(f"{k + 100},{gain:.3f},{overshoot:.2f},{settling:.2f},{temper:.2f},{'ab'[k % 2]}")
    return "\n".join(lines) + "\n"


@pytest.fixture
def person(monkeypatch):
    """Let a person in memory answer in place of the terminal, by a cost of the KPIs; gives all they saw."""

    def answers_by(cost, most=100):
        seen = []

        def converse(interview, console):
            for number in count():
                now = until(interview, lambda now: now.question or now.phase is Phase.OVER, 120.0)
                if now.question is None:
                    until(interview, lambda _: interview.known.is_told, 60.0)
                if now.question is None or number == most:
                    return
                sides = now.question.left.experiment, now.question.right.experiment
                seen.extend(dict(e.kpis) | {"row": int(e.theta[0])} for e in sides)
                left, right = (cost(e.kpis) for e in sides)
                interview.do(actions.Answer(now.question.id, Choice.LEFT if left < right else Choice.RIGHT))

        monkeypatch.setattr("prefcal_app.cli.calibrate.converse", converse)
        return seen

    return answers_by


def hasty(kpis):
    return kpis["settling"] + 0.3 * kpis["overshoot"]


def every(tmp_path):
    """The numbers of each row of the table, by the heading's name."""
    names, *lines = (tmp_path / "runs.csv").read_text().splitlines()
    names = [name.partition(" [")[0] for name in names.split(",")]
    return [dict(zip(names[:-1], map(float, line.split(",")[:-1]), strict=True)) for line in lines]


def best_of(tmp_path, folder="out"):
    return json.loads((tmp_path / folder / "best.json").read_text("utf-8"))


def choose(*words, study="mine"):
    return ["choose", *words, "--study", study, "--terminal", "--out", "out"]


def test_ten_questions_find_one_of_the_rows_that_the_person_wants(done, person, tmp_path):
    seen = person(hasty)
    out = done(*choose("runs.csv", "--lower", "overshoot,settling"))
    assert len(seen) <= 20
    best, rows = best_of(tmp_path), every(tmp_path)
    row = rows[best["theta"]["row"] - 1]
    assert sorted(map(hasty, rows)).index(hasty(row)) < 6
    assert {n: best["kpis"][n] for n in ("overshoot", "settling")} == {
        n: row[n] for n in ("overshoot", "settling")
    }
    assert best["settings"]["row"] == best["theta"]["row"]
    assert best["settings"]["K_p"] == row["K_p"]
    assert best["settings"]["run"] == row["run"]
    assert best["settings"]["operator"] == "ab"[(best["theta"]["row"] - 1) % 2]
    assert "lower settling (" in out
    assert "do not explain" not in out  # the order of the rows could, by chance


def test_only_rows_are_shown_and_none_twice(done, person, tmp_path):
    seen = person(hasty)
    done(*choose("runs.csv"))
    rows = every(tmp_path)
    assert all(row["overshoot"] == rows[row["row"] - 1]["overshoot"] for row in seen)
    shown = [s.theta for s in state_of("mine").history.samples]
    assert len(set(shown)) == len(shown)


def test_of_a_column_without_a_direction_the_answers_show_it(done, person, tmp_path):
    person(lambda kpis: -kpis["temper"])
    out = done(*choose("runs.csv", "--kpis", "temper", "--lower", "overshoot"))
    assert "higher temper (" in out
    assert best_of(tmp_path)["kpis"]["temper"] > 8
    assert not {"more temper", "less temper"} & best_of(tmp_path)["kpis"].keys()


def test_what_counts_is_said_and_units_are_read(tmp_path):
    scenario = load(f"{tmp_path / 'runs.csv'} " + json.dumps({"lower": ["settling"], "kpis": ["temper"]}))
    assert "Lower is better: settling. Your answers show which way: temper." in scenario.brief
    assert "Only shown: K_p, overshoot. Only in best.json: run, operator." in scenario.brief
    assert {k.name: k.unit for k in scenario.shown_kpis} == {
        "K_p": "%/m",
        "overshoot": "%",
        "settling": "s",
        "temper": "",
    }
    assert [k.name for k in scenario.kpis if k.goal] == ["settling", "less temper", "more temper"]
    every_one = load(str(tmp_path / "runs.csv"))
    assert "Your answers show which way: K_p, overshoot, settling, temper." in every_one.brief


def test_a_study_is_resumed_undone_and_reported_as_others_are(done, refused, person, tmp_path, monkeypatch):
    words = choose("runs.csv", "--lower", "overshoot,settling")
    person(hasty, most=3)
    done(*words)
    assert len(state_of("mine").answers) == 3

    def undo(interview, console):
        now = until(interview, lambda now: now.question)
        interview.do(actions.Undo(now.version))

    monkeypatch.setattr("prefcal_app.cli.calibrate.converse", undo)
    done(*choose("runs.csv"))
    assert len(state_of("mine").answers) == 2
    person(hasty)
    done(*choose("runs.csv"))
    assert state_of("mine").ended
    done("report", "mine", "--out", "again")
    assert best_of(tmp_path, "again")["theta"] == best_of(tmp_path)["theta"]
    assert "lower" in refused(*choose("runs.csv", "--lower", "settling"))
    done(*words)


def test_a_table_that_changed_is_refused_and_one_that_moved_is_not(done, refused, person, tmp_path):
    person(hasty, most=2)
    done(*choose("runs.csv", "--lower", "settling"))
    (tmp_path / "there").mkdir()
    (tmp_path / "runs.csv").rename(tmp_path / "there" / "runs.csv")
    done(*choose("there/runs.csv"))
    (tmp_path / "there" / "runs.csv").write_text(table(ROWS - 1))
    assert "has changed since it began" in refused(*choose("there/runs.csv"))
    assert "has changed since it began" in refused("report", "mine", "--scenario", "there/runs.csv")


def test_it_can_begin_with_the_row_in_use(done, person, tmp_path):
    person(hasty)
    done(*choose("runs.csv", "--lower", "overshoot,settling", "--start", "row=17"))
    assert state_of("mine").history.samples[0].theta == (17.0,)
    assert best_of(tmp_path)["before"]["theta"] == {"row": 17}


@pytest.mark.parametrize(
    ("content", "words", "said"),
    [
        ("", (), "got no line"),
        ("a,b\n", (), "got 0 of 0"),
        ("a,b\n1,2\n", (), "two rows or more that differ in a number that counts, got 1 of 1"),
        ("a,b\n1,2\n1,2\n", (), "Left out: row 2, with the numbers of an earlier one"),
        ("a,b\nx,y\nz,w\n", (), "with numbers in no column"),
        ("a,b\n1,2\nx,3\n4,5\n6,7\n", (), "line 3, column 'a': expected a number, got 'x'"),
        ("a,a\n1,2\n3,4\n", (), "column 'a' appears 2 times"),
        ("a,b\n1,2,3\n3,4\n", (), "line 2 has 3 cells under 2 headings"),
        ("a,b\n1,2\n3,4\n", ("--lower", "c"), "no column is called 'c'; there are 'a', 'b'"),
        ("a,b\n1,2\n3,4\n", ("--lower", "a", "--higher", "a"), "column 'a' is named twice"),
        ("a,b\nx,2\ny,4\n", ("--lower", "a"), "column 'a': expected a number, got 'x'"),
        ("a,b\n1,5\n2,5\n", ("--lower", "b"), "The same in all, so it does not count: b"),
        ("a,b\n1,2\n3,4\n", ("--n-max", "3"), "--n-max must be at most 2"),
        ("\x81\0", (), "t.csv: the file is neither text nor Parquet nor a workbook"),
        ("a,b\n1,2\n3,4\n", ("--lower", ","), "--lower must name a column, got ','"),
        ("a,b\n1,2\n3,4\n", ("--of", "mine"), "'t.csv' is a file, got 'mine'"),
    ],
)
def test_what_cannot_be_chosen_from_is_refused_with_the_reason(refused, tmp_path, content, words, said):
    (tmp_path / "t.csv").write_text(content)
    assert said in refused("choose", "t.csv", "--terminal", *words)


def test_a_missing_file_and_what_is_no_table_are_refused(refused):
    assert "No such file" in refused("choose", "none.csv")
    assert "expected a table (.csv, " in refused("choose", "servo")


def test_rows_that_cannot_be_compared_are_left_out_and_said(tmp_path):
    (tmp_path / "t.csv").write_text("a,b,c\n1,,5\n2,3,5\n4,,5\n3,9,5\n3,9,5\n5,inf,5\n")
    scenario = load(str(tmp_path / "t.csv"))
    assert scenario.source.candidates.tolist() == [[2], [4], [6]]
    assert "Left out: rows 1, 3, without a number in all that counts." in scenario.brief
    assert "Left out: row 5, with the numbers of an earlier one." in scenario.brief
    assert "The same in all, so it does not count: c." in scenario.brief
    assert not scenario.space.allows(np.array([3.0]))
    assert scenario.run(np.array([6.0])).kpis == {"a": 5.0, "b": np.inf, "c": 5.0}


def test_of_very_many_rows_some_are_candidates_and_that_is_said(tmp_path):
    (tmp_path / "t.csv").write_text("a\n" + "\n".join(map(str, range(3, 12003))))
    scenario = load(str(tmp_path / "t.csv"))
    assert len(scenario.source.candidates) == 10_000
    assert "10,000 of 12,000 rows are candidates, evenly spaced." in scenario.brief


def test_what_optuna_exports_is_recognized(tmp_path):
    (tmp_path / "trials.csv").write_text(
        ",number,values_0,datetime_start,duration,params_x,params_kind,user_attrs_x,user_attrs_size,state\n"
        "0,4,0.3,2026-11-28 04:44:27,0 days,0.5,a,7,1.5,COMPLETE\n"
        "1,5,0.2,2026-11-28 04:44:28,0 days,0.4,b,8,2.5,COMPLETE\n"
        "2,6,,2026-11-28 04:44:29,0 days,0.3,b,9,3.5,FAIL\n"
        "3,8,0.1,2026-11-28 04:44:30,0 days,0.2,a,6,0.5,COMPLETE\n"
    )
    scenario = load(str(tmp_path / "trials.csv") + ' {"lower": ["values_0"], "kpis": ["size"]}')
    assert scenario.space.names == ("trial",)
    assert scenario.source.candidates.tolist() == [[4], [5], [8]]
    assert "Left out: trial 6, which did not complete." in scenario.brief
    assert scenario.settings(np.array([5.0])) == {
        "trial": 5,
        "params_x": 0.4,
        "user_attrs_x": 8.0,
        "kind": "b",
    }
    free = load(str(tmp_path / "trials.csv"))
    assert "Your answers show which way: values_0, user_attrs_x, size. Only shown: params_x." in free.brief


def test_of_an_unknown_direction_it_is_only_said_which_is_higher(tmp_path):
    scenario = load(f"{tmp_path / 'runs.csv'} " + json.dumps({"lower": ["settling"], "kpis": ["temper"]}))
    new, best = (
        Experiment.blank(np.array([1.0]), Channels((), (), ()), End.TIME_UP, kpis)
        for kpis in ({"settling": 9.0, "temper": 7.0}, {"settling": 8.0, "temper": 3.0})
    )
    reason = Reason(0.5, ("more temper",), ("less temper", "settling"))
    told = why(as_shown(reason, scenario, new, best), scenario, side="Left")
    assert told == "Left has higher temper, but higher settling (chance that you prefer it: 50 %)."
    told = why(as_shown(reason, scenario, best, new), scenario, side="Left")
    assert told == "Left has lower temper and lower settling (chance that you prefer it: 50 %)."
