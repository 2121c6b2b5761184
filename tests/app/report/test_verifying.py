"""A tuning's verification stays beside its best.json, with pictures and a person's verdicts."""

import json
import re
from dataclasses import replace
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from prefcal_app.report import verifying
from prefcal_app.report.pictures import open_loop
from prefcal_app.report.verifying import judge, picture, verify_best, written_beside
from prefcal_app.report.write import FILE, LOOP, data_uri, refresh, write_report
from prefcal_app.view.end import NOMINAL, Told
from prefcal_env.controllers.margins import margin_kpis
from prefcal_env.disk import digest_of
from prefcal_env.envs.varied_loop import DIRECTION, TURN
from prefcal_env.errors import ScenarioError, SettingsError, StaleError
from prefcal_env.sources.source import plant_of
from prefcal_scenarios import KPI, load
from prefcal_scenarios.described.description import join_limits
from prefcal_scenarios.verification import verify
from prefcal_scenarios.verification.nominal import margins_at
from prefcal_scenarios.verification.result import command_of
from prefcal_scenarios.verification.said import BEST, REPEAT, Verified
from prefcal_scenarios.verification.said import FILE as VERIFICATION
from prefcal_scenarios.wording import measured_texts
from support.verified import FOUND
from toy_study import toy_record

LAG = {"K": 2.0, "T_i": 20.0, "T_d": 3.0, "T_f": 3.0, "b": 0.5, "T_t": 20.0}


@pytest.fixture
def best(tmp_path):
    content = {"format": 1, "scenario": "lag", "theta": LAG, "settings": {}}
    (tmp_path / BEST).write_text(json.dumps(content))
    return tmp_path / BEST


def test_a_verification_stays_beside_its_tuning_and_takes_verdicts(best):
    seen = []
    clock = datetime(2026, 11, 29, 12, 32, tzinfo=UTC).astimezone
    said = verify_best(best, 4, jobs=1, progress=lambda *now: seen.append(now), clock=clock)
    assert said.verdict.endswith("Verified 2026-11-29 12:32 UTC.")
    assert Verified.read(best.parent) == said
    assert said.runs == 4
    assert seen[-1][0] == seen[-1][1]
    assert max(total for _, total in seen) > 4
    assert all((best.parent / picture(k)).read_bytes().startswith(b"\x89PNG") for k in range(3))
    (best.parent / FILE).write_text(SHEET)
    judge(best.parent, 1, acceptable=False)
    assert data_uri((best.parent / LOOP).read_bytes()) in (best.parent / FILE).read_text()
    told = judge(best.parent, 2, acceptable=True)
    assert [each.verdict for each in told.worst] == ["", "not acceptable", "acceptable"]
    assert Verified.read(best.parent) == told
    assert replace(told, worst=said.worst) == said


def test_the_nominal_run_reads_as_in_the_study(best):
    # With other noise, one page had two values of each KPI: 1.424 s and 1.42 s.
    best.write_text(json.dumps(json.loads(best.read_text()) | {"study": {"seed": 18}}))
    lag, theta = load("lag"), np.array(list(LAG.values()))
    ours, others = (measured_texts(lag.kpis, lag.run(theta, seed=seed)) for seed in (18, 0))
    assert ours != others
    assert [row[2] for row in verify_best(best, 2, jobs=1).kpis] == ours


def test_a_tuning_that_stays_is_not_run_beside_itself(best):
    content = json.loads(best.read_text())
    columns = []
    for before in ({**LAG, "K": 1.0}, LAG):
        best.write_text(json.dumps(content | {"before": {"what": "current tuning", "theta": before}}))
        said = verify_best(best, 2, jobs=1)
        columns.append((said.margin_columns, "Before" in said.statement))
        assert "Stopped" not in said.statement
    assert columns == [(("margin", "result", "current tuning"), True), (("margin", "result"), False)]


def test_an_open_loop_of_another_tuning_is_removed(best):
    said = verify_best(best, 2, jobs=1)
    told = Told.read(best.parent)
    assert told.margins == tuple(f"{name}: {value}" for name, value in said.margins)
    assert told.noise == said.noise
    assert len(told.noise.rows) > 3
    write_report(toy_record(), best.parent)
    assert not (best.parent / LOOP).exists()
    assert not (best.parent / NOMINAL).exists()


def test_the_open_loop_of_a_plant_that_each_run_makes_anew_is_drawn():
    reactor = load("cstr")
    plant = plant_of(reactor.source)
    assert [channel.name for channel in plant.inputs] == ["coolant temperature"]
    found = margins_at(reactor.source.varied(), reactor.space.decode(np.full(len(reactor.space), 0.5)))
    assert open_loop([found], reactor.kpis, plant).startswith(b"\x89PNG")


def test_a_verdict_on_a_run_of_another_tuning_is_stale(best):
    with pytest.raises(StaleError, match="verify again"):
        judge(best.parent, 0, acceptable=True)
    verify_best(best, 2, jobs=1)
    with pytest.raises(StaleError, match="worst run 9"):
        judge(best.parent, 8, acceptable=True)
    best.write_text(best.read_text() + "\n")
    with pytest.raises(StaleError, match="verify again"):
        judge(best.parent, 0, acceptable=True)


def test_a_verification_of_the_tuning_before_does_not_count_for_a_new_file(best):
    def changed(done, planned):
        best.write_text(best.read_text().replace("2.0", "1.0"))

    with pytest.raises(StaleError, match=r"best\.json.* changed while its tuning was verified"):
        verify_best(best, 2, jobs=1, progress=changed)
    assert sorted(best.parent.iterdir()) == [best]


def test_another_name_and_a_folder_that_cannot_be_written_are_refused_at_once(best, monkeypatch):
    def never(done, planned):
        raise AssertionError

    monkeypatch.setattr("prefcal_scenarios.wording.os.access", lambda *_: False)
    with pytest.raises(SettingsError, match=f"cannot write into the folder {best.parent}"):
        verify_best(best, progress=never)
    with pytest.raises(ScenarioError, match=r"must be called best\.json.*tuned\.json"):
        verify_best(best.rename(best.with_name("tuned.json")), progress=never)


def test_a_stop_before_the_first_run_changes_nothing_and_verdicts_on_the_same_runs_stay(best):
    def stop(done, planned):
        raise KeyboardInterrupt

    verify_best(best, 4, jobs=1)
    told = judge(best.parent, 0, acceptable=False)
    with pytest.raises(ScenarioError, match="stopped before a random run was completed"):
        verify_best(best, 50, jobs=1, progress=stop)
    assert Verified.read(best.parent) == told
    assert verify_best(best, 4, jobs=1) == told
    assert [each.verdict for each in verify_best(best, 4, jobs=1, ranges={"noise": 1}).worst] == [""] * 3
    (best.parent / VERIFICATION).unlink()
    verify_best(best, 1, jobs=1)
    assert [each.name for each in best.parent.glob("worst*")] == [picture(0)]


def test_fewer_runs_than_are_there_are_kept_beside_and_change_nothing_else(best):
    (best.parent / FILE).write_text(SHEET)
    said = verify_best(best, 4, jobs=1)
    before = {path.name: path.read_bytes() for path in best.parent.iterdir()}
    assert written_beside(said, best.parent) == ""
    fewer = verify_best(best, 3, jobs=1)
    assert written_beside(fewer, best.parent) == "verification-3-runs.json"
    assert '"runs": 3' in (best.parent / "verification-3-runs.json").read_text()
    assert {name: (best.parent / name).read_bytes() for name in before} == before
    assert verify_best(best, 4, jobs=1, ranges={"noise": 0}) == Verified.read(best.parent) != said
    best.write_text(best.read_text() + "\n")  # of another tuning, any number is new
    assert verify_best(best, 2, jobs=1) == Verified.read(best.parent)


def test_limits_judge_a_verification_and_count_when_it_is_repeated(best):
    said = verify_best(best, 4, jobs=1, limits=["overshoot <= 0.1 %", "effort <= 1e6"])
    assert said.limits == ("overshoot <= 0.1 %", "effort <= 1e6")
    assert said.headline.startswith("Does not hold")
    assert said.limits_kept.endswith(
        "Stated for this verification, not in the study: overshoot <= 0.1 %; effort <= 1e6."
    )
    assert [row[1] for row in said.kpis if row[1]] == ["≤ 0.1 %", "≤ 1000000 %"]
    assert said.lines == ()
    assert [row[1:] for row in said.required] == [("≤ 0.1 %", False), ("≤ 1000000 %", True)]
    assert verify_best(best, 4, jobs=1) == said
    assert "end safely and settle" in verify_best(best, 4, jobs=1, limits=()).headline


def test_what_is_verified_again_by_the_page_is_asked_as_before(best):
    said = verify_best(best, 5, jobs=1, limits=["overshoot <= 5 %"], ranges={"dead time": [0, 0.5]}, seed=3)
    assert (said.planned, said.seed, said.ranges) == (5, 3, {"dead time": [0, 0.5]})
    assert verify_best(best, jobs=1) == said == Verified.read(best.parent)


def test_a_limit_looser_than_that_of_the_study_is_the_first_thing_said(tmp_path):
    (tmp_path / "own.py").write_text(
        "from prefcal_env import Plant\nplant = Plant.of(([2.0], [20, 1]), delay=3.0)\n"
    )
    study = 'controller = "pid"\nplant = "own.py:plant"\n[kpis]\novershoot = 2\nsettling_time = 500\n'
    (tmp_path / "study.toml").write_text(study)
    theta = {"K_p": 2.2, "T_i": 20.0, "T_d": 0.5, "b": 1.0}
    content = {"format": 1, "scenario": "study.toml", "theta": theta, "settings": {}}
    (tmp_path / BEST).write_text(json.dumps(content))
    limits = ["overshoot <= 60 %", "settling_time <= 400"]
    said = verify_best(tmp_path / BEST, 4, jobs=1, limits=limits)
    first = "By looser limits than the study's (overshoot of y ≤ 60 % in place of ≤ 2 %): "
    assert said.headline.startswith(first)
    assert not verify_best(tmp_path / BEST, 4, jobs=1, limits=limits[1:]).headline.startswith("By looser")


@pytest.mark.parametrize("anew", ["", "prefcal calibrate a.toml --calibrator human"])
def test_the_result_is_compared_with_another_tuning_by_the_same_limits(anew):
    tuning, best = SimpleNamespace(anew=anew, source="a.toml", before=LAG), Path("out", BEST)
    begin = f"run: {anew}" if anew else REPEAT
    another = verifying._begin_another(tuning, best, ["x <= 1"])
    assert another == f"{begin} --limit 'x <= 1' --start out/best.json"
    tuning.source = "lag"  # what is no file of a plant takes no limits
    assert verifying._begin_another(tuning, best, ["x <= 1"]) == f"{begin} --start out/best.json"


def test_a_relaxed_limit_takes_the_place_of_that_of_the_same_kpi_in_a_whole_command():
    titles, stated = {"settling time": "ts", "overshoot": "most"}, ["settling time <= 2", "most <= 10"]
    command = partial(command_of, best="there/best.json", more=verifying._options_of(60, {"parameter": 0.2}))
    begin = "prefcal verify there/best.json --runs 60 --range parameter=0.2"
    new = command(3, join_limits(stated, ["ts <= 3 s"], titles))
    assert new == f"{begin} --seed 3 --limit 'most <= 10' --limit 'ts <= 3 s'"
    new = command(0, join_limits(stated, ["most <= 12"], titles))
    assert new == f"{begin} --limit 'settling time <= 2' --limit 'most <= 12'"


def test_limits_of_a_verification_are_stated_in_a_file_only_where_there_is_one():
    M_s, *_ = (replace(k, at_most=2.0) for k in margin_kpis("s") if k.name == "M_s")
    assert verifying._how_to_state("own.py:tank", ["M_s <= 2"], [M_s]) == (
        f"; first state M_s <= 2 in the KPIs of your file (a margin as {verifying._as_code(M_s)})"
    )
    assert verifying._how_to_state("cstr", ["T <= 2"], [M_s]) == (
        "; cstr takes no limits of yours: verify the result of that by the same ones"
    )


def test_a_margin_is_named_as_a_python_file_states_it():
    M_s, phase, *_ = (k for k in margin_kpis("s") if k.name in ("M_s", "phase_margin"))
    code = verifying._as_code(replace(M_s, at_most=1.3))
    assert code == 'KPI("M_s", "maximum sensitivity M_s", "", at_most=1.3, margin=True)'
    assert eval(code, {"KPI": KPI}).met(1.31) is False
    assert verifying._as_code(replace(phase, at_least=45.0)).endswith('"°", at_least=45, margin=True)')


def test_what_an_earlier_verification_of_the_same_tuning_said_stands_beside_one_that_asks_otherwise():
    words = "Does not hold: 4 of 9 runs, required ≤ 2.5 s; 3 end unsafe"
    first = replace(FOUND, at="2026-11-30 15:32 UTC", headline=f"{words}. More.", planned=299)
    same = verifying._with_earlier(FOUND, first)
    assert (same.earlier, same.statement) == ((), FOUND.statement)
    narrow = replace(FOUND, planned=299, ranges={"parameter": 0.02}, seed=2)
    once = verifying._with_earlier(narrow, first)
    told = f"2026-11-30 15:32 UTC, as usual: {words}"
    assert once.statement == f"{narrow.statement} Verified before, otherwise: {told}."
    again = verifying._with_earlier(narrow, once)
    assert again.earlier == once.earlier == (told,), "repeated in the same way, it adds nothing"
    back = verifying._with_earlier(replace(first, at="later"), replace(once, at="then"))
    said = once.headline.removesuffix(".").split(". ")[0]
    assert back.earlier == (f"then, --range parameter=0.02 --seed 2: {said}",), "asked again, no other"
    assert verifying._with_earlier(FOUND, None) == FOUND


def test_why_a_robust_study_counts_otherwise_than_a_verification_is_said_beside_its_count(best):
    content = json.loads(best.read_text())
    for robust, count in ((True, 1), (False, 0)):
        best.write_text(json.dumps(content | {"study": {"robust": "yes"} if robust else {}}))
        statement = verify_best(best, 2, jobs=1).statement
        assert statement.count("The robust study counted other draws, without") == count
    lag, theta = load("lag"), np.array(list(LAG.values()))
    found = verify(lag, theta, 40, jobs=1)
    turned = [run.values[DIRECTION] < 0 or run.values[TURN] < 0 for run in found.failed]
    assert turned
    plain = " The robust study counted other draws, without sensors, actuators and task."
    assert verifying._tell_apart(found, lag.kpis) == plain
    limited = [replace(kpi, at_most=1e9) for kpi in lag.kpis]  # what varies follows from the study's limits
    assert verifying._tell_apart(found, limited) == (
        " The robust study counted other draws, without sign of the load and sign of the step: "
        f"{sum(turned)} of the {len(turned)} failures have that turned."
    )
    good = tuple(run for run in found.runs if not run.problems)
    for runs, said in (
        (good, " The robust study counted other draws, without sign of the load and sign of the step."),
        ((), ""),
    ):
        assert verifying._tell_apart(replace(found, tuning=replace(found.tuning, runs=runs)), limited) == said


def test_a_result_with_which_its_study_began_stands_once_in_the_command():
    anew = "prefcal calibrate lag --calibrator human --start K=2"
    tuning = SimpleNamespace(anew=anew, source="lag", before=None)
    assert verifying._begin_another(tuning, Path(BEST), []) == f"run: {anew}"


def test_what_compares_another_tuning_unattended_has_a_folder_that_is_free(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "out-2").mkdir()
    tuning = SimpleNamespace(anew="prefcal calibrate lag --calibrator synthetic", source="lag", before=LAG)
    begun = f"run: {tuning.anew} --out"
    assert verifying._begin_another(tuning, Path("out", BEST), []) == f"{begun} out-3 --start out/best.json"
    assert verifying._begin_another(tuning, Path(BEST), []) == f"{begun} {tmp_path.name}-2 --start best.json"


def test_an_own_scenario_that_states_no_kpis_is_limited_by_those_of_its_run(tmp_path):
    text = OWN.replace("seed=0", "seed=0, mass=1.2")
    (tmp_path / "mine.py").write_text(text)
    content = {"format": 1, "scenario": "mine.py:SCENARIO", "theta": {"gain": 1.0}, "settings": {}}
    (tmp_path / BEST).write_text(json.dumps(content))
    with pytest.raises(ScenarioError, match="--limit: there is no KPI 'right'"):
        verify_best(tmp_path / BEST, 2, jobs=1, limits=["right <= 1"])


@pytest.mark.parametrize(
    ("code", "says", "nominal"),
    [
        ("sys.exit(3)", "failed: run called exit: 3", True),
        ("time.sleep(1e6)", "failed: .*2 s", True),
        ("os._exit(7)", "the run failed: .*exit code 7", False),
    ],
)
def test_own_code_that_ends_or_hangs_keeps_nobody(tmp_path, code, says, nominal):
    text = OWN.replace("seed=0", "seed=0, mass=1.2")
    text = text.replace(
        "    t =", f"    import os, sys, time\n    if (mass == 1.2) == {nominal}: {code}\n    t ="
    )
    (tmp_path / "mine.py").write_text(text)
    content = {"format": 1, "scenario": "mine.py:SCENARIO", "theta": {"gain": 1.0}, "settings": {}}
    (tmp_path / BEST).write_text(json.dumps(content))
    timeout = 2 if "sleep" in code else None
    if nominal:
        with pytest.raises(ScenarioError, match=says):
            verify_best(tmp_path / BEST, 1, jobs=1, timeout=timeout)
    else:
        said = verify_best(tmp_path / BEST, 1, jobs=1, timeout=timeout)
        assert re.match(says, said.worst[0].words)
        assert not list(tmp_path.glob("worst_run*"))


def test_what_cannot_be_varied_is_refused_and_leaves_nothing(tmp_path):
    (tmp_path / "mine.py").write_text(OWN)
    content = {"format": 1, "scenario": "mine.py:SCENARIO", "theta": {"gain": 1.0}, "settings": {}}
    (tmp_path / BEST).write_text(json.dumps(content))
    with pytest.raises(ScenarioError, match="argument"):
        verify_best(tmp_path / BEST, 3)
    assert Verified.read(tmp_path) is None


SHEET = "<!-- verified -->not verified<!-- end -->"

OWN = """
import numpy as np
from prefcal_env import Knob, KnobSpace, recorded
from prefcal_scenarios import KPI, Scenario

def run(theta, seed=0):
    t = np.linspace(0, 1, 11)
    return recorded(theta, t, {"x": theta[0] * t}).with_kpis({"end": float(theta[0])})

SCENARIO = Scenario("mine", "Mine", KnobSpace([Knob("gain", 0, 5)]), run, kpis=(KPI("end", "end"),))
"""


def test_sheet_and_report_say_what_was_verified_from_one_list_also_when_it_is_known_later(tmp_path):
    record = toy_record()
    write_report(record, tmp_path)
    assert "Run prefcal verify" in (tmp_path / "report.html").read_text(encoding="utf-8")
    replace(FOUND, best=digest_of(tmp_path / BEST)).write(tmp_path)
    refresh(tmp_path)
    for name, cells in (("report.html", 2), ("acceptance.html", 1)):  # one page has no room for reasons
        text = (tmp_path / name).read_text(encoding="utf-8")
        for each in (FOUND.statement, *(cell for row in FOUND.left_out for cell in row[:cells])):
            assert each in text, (name, each)
        assert "Run prefcal verify" not in text
        later = text
        write_report(record, tmp_path)
        assert (tmp_path / name).read_text(encoding="utf-8") == later
