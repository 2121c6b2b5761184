"""The acceptance sheet answers what is asked of a tuning, or says "not verified"."""

import json
import re
from dataclasses import replace
from html import unescape
from pathlib import Path
from types import SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest

from prefcal_app.report.export import best_as_json
from prefcal_app.report.record import StudyRecord
from prefcal_app.report.write import (
    FILE,
    answers,
    page,
    refresh,
    sheet,
    unverified,
    verdict_of,
    verified_answers,
    verified_tables,
    write_report,
)
from prefcal_app.summary import Outlook
from prefcal_app.view.end import tell_margins
from prefcal_env.disk import digest_of
from prefcal_env.experiments.experiment import End
from prefcal_scenarios.catalog import load
from prefcal_scenarios.isolated import isolation
from prefcal_scenarios.scenario import KPI
from prefcal_scenarios.verification import nominal, verify
from prefcal_scenarios.verification.said import BEST
from support.verified import FOUND
from toy_study import PID_SETTINGS, toy_record


def test_who_answered_what_and_why_the_result_is_the_result():
    record = replace(toy_record(), settings={"calibrator": "human"}, digest="ab12")
    found = dict(answers(record))
    named = dict(answers(replace(record, by="Ada")))["Who answered"]
    assert named == found["Who answered"].replace("by a person", "by Ada")
    program = dict(answers(toy_record()))["Who answered"]
    assert "comparisons by a simulated person (" in program
    who = found["Who answered"]
    assert who.startswith(f"{len(record.trials)} experiments, {record.questions} comparisons by a person (")
    for words, count in record.verdict_counts().items():
        assert (f"{words} {count}" in who) == (count > 0)
    assert who.endswith("SHA-256 of the study file: ab12.")
    assert found["Why this one"].startswith("It is the best by the answers")
    assert found["Left to gain"].startswith("Not stated")
    told = Outlook(promise="Fewer than 4 % are better.", result=("The answers fit these wishes: calmness.",))
    found = dict(answers(replace(record, outlook=told)))
    assert found["Left to gain"] == "Fewer than 4 % are better."
    assert found["Why this one"] == "The answers fit these wishes: calmness."
    holds = (
        "The result keeps the limits in all 300 runs with varied plants (not sensors, actuators or task).",
        "They vary the gain.",
    )
    told = replace(told, result=(*holds, *told.result))
    robust = replace(record, outlook=told, trust="A sum predicted 4 of 6 answers.", robust=holds)
    found = dict(answers(robust))
    assert found["Robust study"] == " ".join(holds)
    assert found["Why this one"] == "The answers fit these wishes: calmness."
    won = "Experiment 2 won, but 3 is the best so far."
    found = dict(answers(replace(robust, outlook=replace(told, unbeaten=won))))
    assert found["Why this one"] == f"{won} The answers fit these wishes: calmness."
    assert dict(answers(replace(record, outlook=Outlook(unbeaten=won))))["Why this one"] == won
    assert found["Left to gain"] == "Fewer than 4 % are better. A sum predicted 4 of 6 answers."
    more = replace(
        robust,
        outlook=replace(told, more="Run: prefcal calibrate x", ends="Widen it with:", command="respace"),
    )
    assert dict(answers(more))["Left to gain"].endswith(
        " of 6 answers. Widen it with: respace Run: prefcal calibrate x"
    )
    assert f"The study was robust. {holds[0]} They vary the gain." in page(robust, [])
    left = dict(answers(toy_record(stop_after=4)))
    assert left["Left to gain"] == "Not stated: the study was left before its end."
    assert "Robust study" not in left


def test_a_partial_report_says_that_an_experiment_waits_for_its_answer():
    left = toy_record(stop_after=7)
    waits = replace(left, waiting={7: toy_record().trials[7].experiment})
    assert len(waits.trials) == waits.n_max == 8
    assert "The study was stopped after 8 of 8 experiments, one of them not compared." in page(waits, [])
    assert "The study was stopped after 7 of 8 experiments." in page(left, [])


def test_a_study_that_ended_is_no_partial_one():
    left = toy_record(stop_after=4)
    assert "the study is not complete" in dict(answers(left))["Who answered"]
    assert "Partial report" in page(left, [])
    for ended, words in (
        ("little is left to gain", "few random θ are noticeably better"),
        ("good enough", "the best is good enough"),
        ("all compared", "all compared"),
    ):
        record = replace(left, ended=ended)
        assert "complete" not in dict(answers(record))["Who answered"]
        said = page(record, [])
        assert "Partial report" not in said
        assert f"Ended after 4 of at most 8 experiments: {words}." in said


def test_a_study_that_the_person_finished_is_not_partial():
    finished = replace(toy_record(stop_after=4), ended="stopped")
    said = page(finished, [])
    assert "Partial report" not in said
    assert "The person who answered finished the study after 4 of 8 experiments.</p>" in said
    told = dict(answers(finished))
    assert "complete" not in told["Who answered"]
    assert "left before its end" not in told["Left to gain"]
    assert json.loads(best_as_json(finished))["complete"]


def test_what_nobody_looked_at_is_not_verified():
    found = dict(unverified(toy_record()))
    assert found["Margins"].startswith("not verified: ")
    assert "dead times, noise, loads and set points" in found["Other plants"]
    assert "Run prefcal verify best.json" in found["Other plants"]


class Study(SimpleNamespace):
    """A study without comparisons, of which only margins are asked."""

    margins, margin_words, noise = StudyRecord.margins, StudyRecord.margin_words, StudyRecord.noise
    _both, _nominal, kpis = StudyRecord._both, StudyRecord._nominal, StudyRecord.kpis
    settings: ClassVar = {"seed": 3}


def test_margins_stand_beside_those_before_and_an_error_of_own_code_is_said(monkeypatch):
    loop = load("lag")
    theta = loop.space.decode(np.full(len(loop.space), 0.5))
    trial = SimpleNamespace(index=0, experiment=loop.run(theta))
    old = SimpleNamespace(index=1, experiment=trial.experiment)
    known = {"scenario": loop, "result": trial, "before": old}
    alone = dict(unverified(Study(scenario=loop, result=trial, before=trial)))["Margins"]
    assert re.fullmatch(r"gain margin \[dB\]: [\d.]+", alone[0])  # nothing was before
    said = dict(unverified(Study(**known)))["Margins"]
    assert re.fullmatch(r"gain margin \[dB\]: [\d.]+ \(before [\d.]+\)", said[0])
    assert "linearized at the operating point" in said[-1]

    def fails(*_):
        raise RuntimeError("no plant")

    monkeypatch.setattr("prefcal_scenarios.verification.nominal.margins", fails)
    assert dict(unverified(Study(**known)))["Margins"] == "not verified: no margins: no plant"


def test_what_is_told_of_somebodys_own_loop_comes_from_a_process_that_may_be_ended(monkeypatch, tmp_path):
    own = (Path(__file__).parents[3] / "docs" / "dc_motor.py").read_text("utf-8")
    (tmp_path / "motor.py").write_text(own.replace("horizon=4.0)", "horizon=4.0, noise=np.array([0.01]))"))
    source = f"{tmp_path / 'motor.py'}:motor"
    here = load(source)
    theta = here.space.decode(np.full(len(here.space), 0.5))
    trial = SimpleNamespace(index=0, experiment=here.run(theta))
    known = {"result": trial, "before": trial}
    with isolation(source) as isolated:
        apart = Study(scenario=isolated(here), **known)
        there = dict(unverified(apart))["Margins"]
        assert dict(unverified(apart)) == dict(unverified(Study(scenario=here, **known)))
        assert [len(row) for row in apart.noise.rows] == [2, 2, 2]
        assert apart.margin_words == there[:-1]
        assert tell_margins(apart.margin_words).startswith("Margins of the nominal loop: gain margin [dB]: ")
        monkeypatch.setattr(nominal, "_PATIENCE", 1e-9)
        late = dict(unverified(Study(scenario=isolated(here), **known)))["Margins"]
        assert re.fullmatch("not verified: no margins: .* took longer than .*", late)


def test_other_draws_of_the_noise_stand_on_the_sheet_before_and_after_verification():
    lag = load("lag")
    new, old = (lag.space.decode(np.full(len(lag.space), share)) for share in (0.5, 0.4))
    after, before = (
        SimpleNamespace(index=k, experiment=lag.run(theta, seed=3)) for k, theta in ((1, new), (0, old))
    )
    told = dict(unverified(Study(scenario=lag, result=after, before=before)))["Other noise"]
    assert told[0] == "with the next 20 seeds, before → after: median (lowest to highest)"
    overshoots = [[lag.run(t, seed=k).kpis["overshoot"] for k in range(4, 24)] for t in (old, new)]
    (said,) = [each for each in told if each.startswith("overshoot")]
    numbers = [float(each) for each in re.findall(r"[\d.]+", said)]
    for shown, values in ((numbers[:3], overshoots[0]), (numbers[3:6], overshoots[1])):
        assert shown == pytest.approx([np.median(values), min(values), max(values)], rel=1e-2, abs=0.01)
    assert numbers[6] == sum(b < a for a, b in zip(*overshoots, strict=True))
    verified = verify(lag, new, 2, start=old, noise=3, jobs=1)
    assert replace(FOUND, noise=verified.with_other_noise).noise.texts == told
    assert dict(verified_answers(replace(FOUND, noise=verified.with_other_noise)))["Other noise"] == told
    assert "Other noise" not in dict(verified_answers(FOUND))
    assert "Other noise" not in dict(unverified(toy_record()))


@pytest.mark.parametrize("content", ["{", '{"x": 1}'])
def test_a_damaged_verification_is_none_and_the_sheet_says_so(tmp_path, content):
    (tmp_path / "verification.json").write_text(content)
    write_report(toy_record(), tmp_path)
    assert (tmp_path / FILE).read_text().count("verification.json is damaged, or of another version") == 2


def test_a_verification_of_another_file_is_said_not_to_count(tmp_path, monkeypatch):
    write_report(toy_record(), tmp_path)
    assert "verification.json" not in (tmp_path / FILE).read_text()
    replace(FOUND, best=digest_of(tmp_path / BEST)).write(tmp_path)
    write_report(toy_record(), tmp_path)
    assert "298 of 299" in (tmp_path / FILE).read_text()
    monkeypatch.setattr("prefcal_app.report.export.versions", lambda: {"prefcal": "0.1.0", "numpy": "9.0"})
    write_report(toy_record(), tmp_path)
    text = (tmp_path / FILE).read_text()
    why = (
        "verification.json is of another best.json: of another tuning, or of other versions of the libraries."
    )
    assert f"run prefcal verify best.json. {why}" in text
    assert "298 of 299" not in text


def test_a_limit_that_only_the_verification_has_stands_in_the_table_of_kpis(folder):
    def row():
        return next(line for line in (folder / FILE).read_text().splitlines() if ">largest move<" in line)

    free = '<tr><th scope="row">largest move</th><td>–</td><td>1</td><td class="best">1</td><td>%</td>'
    assert row() == f"{free}<td>–</td></tr>"
    for required, limits, met in (
        ((("largest move", "≤ 2 %", True),), "≤ 2 % (verify)", '<td class="yes">yes</td>'),
        ((("largest move", "≤ 0.5 %", False),), "≤ 0.5 % (verify)", '<td class="no">NO</td>'),
        ((), "–", "<td>–</td>"),
    ):
        found = replace(FOUND, best=digest_of(folder / BEST), required=required)
        found.write(folder)
        refresh(folder)
        assert row() == f"{free.replace('<td>–', f'<td>{limits}')}{met}</tr>"
        assert sheet(toy_record(), found) == (folder / FILE).read_text()


def test_what_was_verified_is_said_with_what_was_not():
    found = dict(verified_answers(FOUND))
    assert found["Margins"] == (
        "gain margin [dB]: 12 (before 8)",
        "phase margin [°]: 60 (before 44)",
        "the sampled loop",
    )
    assert found["Other plants"] == "298 of 299 runs keep the stated limits. Stated limits: a safe end."
    assert found["Worst run"] == "settling time misses its objective (acceptable): dead time 7.1."
    assert found["Varied"] == (
        "dead time 4.8 to 7.2 s (stated)",
        "noise of the sensors 0 to 0.2 %",
        "drawn with seed 0",
        "beyond these ranges: not verified",
    )
    assert found["Not varied"] == (
        "sampling jitter (a period has one length here)",
        "what the model lacks, such as a resonance (nobody stated it: the margins say how much is bearable)",
        "other loops, also with a wrong sign (they are not in the model)",
        "actuators that differ up and down, or stick (they are as modeled)",
        "failures of sensors and actuators (they are not simulated)",
    )
    unknown = replace(FOUND, margins=(), margins_kept="", basis="no margins: the plant is not known")
    assert dict(verified_answers(unknown))["Margins"] == "not verified: no margins: the plant is not known"


@pytest.fixture
def folder(tmp_path):
    (tmp_path / BEST).write_text(best_as_json(toy_record()))
    (tmp_path / FILE).write_text(sheet(toy_record()))
    return tmp_path


def test_a_verification_completes_the_sheet(folder):
    before = (folder / FILE).read_text()
    refresh(folder)
    assert (folder / FILE).read_text() == before  # nothing was verified
    for _ in range(2):  # and again
        replace(FOUND, best=digest_of(folder / BEST)).write(folder)
        refresh(folder)
        text = (folder / FILE).read_text()
        assert text.count("298 of 299 runs") == 2  # the verdict, and what it rests on
        assert "not verified: how it does" not in text
    (folder / BEST).write_text("{}")
    refresh(folder)
    assert (folder / FILE).read_text() == text  # it is about another tuning


def test_a_folder_without_a_sheet_gets_none(tmp_path):
    refresh(tmp_path)
    assert not (tmp_path / FILE).exists()


def test_the_verdict_stands_above_the_tables_and_is_that_of_page_and_terminal(folder):
    first = (folder / FILE).read_text()
    assert '<p class="verdict"><strong>Not verified on other plants than the modeled one' in first
    judged = replace(FOUND.worst[0], verdict="not acceptable")
    said = replace(FOUND, worst=(judged,), at="2026-11-29 12:32 UTC", best=digest_of(folder / BEST))
    assert said.verdict == (
        "Does not hold: 298 of 299 runs keep the stated limits. A person found 1 of the 1 worst runs not "
        "acceptable. Verified 2026-11-29 12:32 UTC."
    )
    said.write(folder)
    refresh(folder)
    text = re.sub("<[^>]*>", "", (folder / FILE).read_text()).replace("\xa0", " ")
    assert text.index(said.verdict) < text.index("What next: Relax the limit") < text.index("Controller par")
    assert text.count("What next: ") == text.count(said.verdict) == 1
    assert "Not verified on other plants" not in text


def test_a_sheet_whose_own_run_misses_what_is_required_says_so_before_anything_is_verified():
    record = toy_record()
    name, value = next(iter(record.best.experiment.kpis.items()))
    kpis = (KPI(name, "peak", at_most=value - 1.0),)
    missed = replace(record, scenario=replace(record.scenario, kpis=kpis))
    assert verdict_of(missed).startswith("Does not hold: peak, required of the experiment itself, not kept.")
    assert verdict_of(record).startswith("Not verified")


@pytest.mark.parametrize(
    ("limit", "value", "words"),
    [
        (np.inf, np.inf, "The loop is not stable. Not verified"),  # nothing is stated that it does not keep
        (2.0, np.inf, "The loop is not stable. Margins not kept: M_s. Not verified"),
        (2.0, 2.5, "Margins not kept: M_s. Not verified"),
        (np.inf, 2.5, "Not verified"),
    ],
)
def test_a_loop_that_is_not_stable_is_called_so_and_no_limit_is_missed_that_nobody_stated(
    limit, value, words
):
    record = toy_record()
    margin = KPI("M_s", "M_s", better="lower", at_most=limit, margin=True)
    found = SimpleNamespace(experiment=record.result.experiment.with_kpis({"M_s": value}))
    own = SimpleNamespace(kpis=(*record.kpis, margin), result=found)
    assert verdict_of(own).startswith(words)


def test_nothing_of_what_varied_is_cut_and_the_ranges_of_kpis_stand_beside_it(folder):
    varied = tuple((f"factor {k}", "0.9 to 1.1", "stated") for k in range(40))
    outside = "Nominal values outside of 5 to 95 %: overshoot, since the nominal run has no noise."
    replace(FOUND, varied=varied, outside=outside, best=digest_of(folder / BEST)).write(folder)
    refresh(folder)
    text = (folder / FILE).read_text()
    assert all(f"<li>factor {k} 0.9 to 1.1 (stated)</li>" in text for k in range(40))
    assert "<li>overshoot [%]: 0 to 2</li>" in text
    assert f"<li>{outside}</li>" in text.replace("\xa0", " ")
    margins, kpis = verified_tables(replace(FOUND, outside=outside))["tables"]
    assert (margins["caption"], kpis["caption"]) == ("", outside)  # report and page have it at the table
    assert "has all)" not in text


def test_the_experiment_that_was_judged_is_said_in_whole_sentences_of_the_brief():
    record = toy_record()

    def said(brief):
        return dict(answers(replace(record, scenario=replace(record.scenario, brief=brief))))

    steps = "The reference of T steps from 80 to 100 °C at the start. From 541 s on, a load acts: 10 % on v."
    assert said(f"{steps} {'More words ' * 20}.")["Experiment"] == steps
    assert "Experiment" not in said("")


def test_a_pid_is_given_as_control_systems_ask_for_it():
    record = toy_record()
    scenario = replace(record.scenario, settings=lambda theta: PID_SETTINGS)
    said = dict(answers(replace(record, scenario=scenario)))["The PID"]
    assert said.startswith("ISA form: K_p (b r − y + 1/T_i ∫(r − y) dt")
    assert "Against windup the integral also gets ∫(u − v)/T_t dt" in said
    assert "Action: reverse (K_p > 0)." in said
    assert "Not tuned: K_p 2, T_i 10 h, T_d 3 h, b (set-point weight of K_p) 1" in said
    assert "T_s" not in said  # a knob of the toy
    assert "The PID" not in dict(answers(record))


def test_what_only_the_pid_before_had_is_not_said_of_the_tuned_one():
    tuned = {
        "controller": "PID",
        "K_p": 2.0,
        "T_i": None,
        "T_d": 0.0,
        "N": 10.0,
        "b": 1.0,
        "c": 0.0,
        "T_s": 0.5,
    }
    record = toy_record()
    first = record.before.experiment.theta.tolist()

    def settings(theta):
        return tuned | {"T_i": 10.0, "T_t": 7.0} if theta.tolist() == first else tuned

    assert record.best.experiment.theta.tolist() != first
    said = dict(answers(replace(record, scenario=replace(record.scenario, settings=settings))))["The PID"]
    assert "Not tuned: K_p 2, " in said
    assert "T_t (" not in said


def test_lines_that_are_offered_can_be_copied_from_sheet_and_report():
    lines = ("prefcal verify best.json --limit 'overshoot <= 10 %'",)
    offered = replace(FOUND, lines=lines)
    assert dict(verified_answers(offered))["Usual limits"] == {"lines": "\n".join(lines)}
    for text in (sheet(toy_record(), offered), page(toy_record(), [], offered)):
        (found,) = re.findall("<dd><pre>(.*?)</pre>", text, re.DOTALL)
        assert unescape(found) == "\n".join(lines)
    assert "Usual limits" not in dict(verified_answers(FOUND))


def test_a_result_whose_own_run_was_unsafe_does_not_hold():
    record = toy_record()
    best = record.result.index
    unsafe = [
        c._replace(challenger=replace(c.challenger, end=End.UNSAFE))
        if c.query.challenger.index == best
        else c
        for c in record.comparisons
    ]
    said = verdict_of(replace(record, comparisons=tuple(unsafe)))
    assert said.startswith("Does not hold: the experiment itself ended early: unsafe. Not verified on other")


def test_the_sheet_says_that_all_experiments_have_one_draw_of_the_noise(monkeypatch):
    def said(noise):
        monkeypatch.setattr(StudyRecord, "noise", noise)
        return dict(answers(replace(toy_record()))).get("Experiment", "")

    words = "All experiments have the same draw of the sensor noise (seed 1), see Other noise."
    drawn = nominal.Redrawn((("overshoot [%]", "2 (1 to 3)"),))
    assert said(drawn).endswith(words)
    assert said("40 runs take more than 20 s").endswith(words)
    assert "noise" not in said(nominal.Redrawn())
    assert "noise" not in said(replace(drawn, lacking="the noise of step.csv"))
