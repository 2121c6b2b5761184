"""KPIs of a trajectory, by name and by formula."""

import ast
import builtins
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from prefcal_env import Channel, Channels, End, Experiment, recorded, tracking_kpis
from prefcal_env.errors import ScenarioError
from prefcal_env.experiments import kpis as formula
from prefcal_env.experiments.kpis import KPI, Formulas, conversion_of, formula_of, value_of
from prefcal_env.experiments.panels import without_record
from prefcal_env.sources.source import formula_problems

LEVEL, VALVE = Channel("level", "m"), Channel("valve", "%")


def run(level, valve=(0.0, 4.0, 1.0), reference=2.0, *, band=None, t=None, signal=False):
    """An experiment of one output, one input decided at the first instants."""
    level = np.asarray(level, dtype=float)
    t = np.arange(len(level), dtype=float) if t is None else t
    n = len(valve)
    y = Channel("level", "m", band=band)
    return Experiment(
        theta=np.array([1.0]),
        t=t,
        x=np.zeros((len(t), 1)) if signal else level[:, None],
        u=np.zeros((len(t), 1)),
        t_control=t[:n],
        u_control=np.array(valve)[:, None],
        y_ref=np.full((n, 1), reference),
        iterations=np.zeros(n, int),
        solve_time=np.zeros(n),
        solved=np.ones(n, bool),
        end=End.TIME_UP,
        channels=Channels(x=(Channel("other") if signal else LEVEL,), u=(VALVE,), y=(y,)),
        signals={"level": level} if signal else {},
    )


def test_a_curve_by_hand():
    kpis = tracking_kpis(run([6.0, 4.0, 1.0, 2.0, 2.0]))  # errors 4, 2, -1, 0, 0
    assert kpis == {
        "integrated error of level": pytest.approx(3 + 5 / 6 + 0.5),  # 2/3 s on one side, 1/3 s on the other
        "late error of level": pytest.approx(0.5 * 3 + 1.5 * 5 / 6 + 2.5 * 0.5),
        "settling time of level": 3.0,
        "overshoot of level": 1.0,
        "final error of level": 0.0,
        "total move of valve": 7.0,
        "largest move of valve": 4.0,
        "RMS move of valve": pytest.approx(np.sqrt((16 + 9) / 2)),
    }


def test_the_start_of_time_does_not_matter():
    level = [6.0, 4.0, 1.0, 2.0, 2.0]
    shifted = tracking_kpis(run(level, t=np.arange(5.0) + 100.0))
    assert shifted == pytest.approx(tracking_kpis(run(level)))


def test_a_curve_that_never_settles_is_infinite_and_a_band_counts():
    assert tracking_kpis(run([6.0, 4.0, 3.0]))["settling time of level"] == np.inf
    assert tracking_kpis(run([6.0, 4.0, 3.0], band=1.5))["settling time of level"] == 2.0
    assert tracking_kpis(run([2.0, 2.0, 2.0]))["settling time of level"] == 0.0


def test_overshoot_is_beyond_the_reference_from_either_side():
    from_below = tracking_kpis(run([0.0, 1.0, 5.0, 2.0]))
    from_above = tracking_kpis(run([6.0, 5.0, 3.0, 2.0]))
    assert from_below["overshoot of level"] == 3.0
    assert from_above["overshoot of level"] == 0.0


def test_an_output_may_be_a_signal_and_one_that_is_neither_is_left_out():
    assert "overshoot of level" in tracking_kpis(run([6.0, 1.0, 2.0], signal=True))
    unknown = replace(run([6.0, 1.0, 2.0]), channels=Channels((LEVEL,), (VALVE,), (VALVE,)))
    assert not any("error" in name for name in tracking_kpis(unknown))


def test_without_a_record_or_with_holes_nothing_is_said():
    assert tracking_kpis(without_record(replace(run([6.0, 4.0, 1.0]), end=End.FAILED))) == {}
    assert not any("error" in name for name in tracking_kpis(run([1.0, 2.0, 3.0], reference=np.nan)))


@given(arrays(float, st.integers(3, 12), elements=st.floats(-1e100, 1e100)))
def test_every_kpi_is_a_number_that_is_not_negative(level):
    kpis = tracking_kpis(run(level))
    assert len(kpis) in (8, 9)  # a load may be found
    assert all(value >= 0 for value in kpis.values())


T = np.linspace(0.0, 10.0, 101)
SWINGING = 2 * (1 - np.exp(-T) * np.cos(2 * T))
RUN = recorded(
    [1.0],
    T,
    {"level": SWINGING, "tank.T": 3 * SWINGING},
    {"valve": np.sin(T)},
    {"level": 2.0},
    signals={"load": np.where(T < 5, 0.0, np.nan)},
)


def value(text):
    return value_of(text, RUN)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("max(level) - ref(level)", SWINGING.max() - 2),
        ("max(abs(level - ref(level)), after=5)", np.abs(SWINGING - 2)[50:].max()),
        ("min(level, after=1, before=2)", SWINGING[10:21].min()),
        ("first(level) + 2 * last(level) - -1", 2 * SWINGING[-1] + 1),
        ("peak_to_peak('tank.T') / 3", np.ptp(SWINGING)),
        ("mean(level)", np.trapezoid(SWINGING, T) / 10),
        ("rms(valve) ** 2", (np.sin(T[:-1]) ** 2).mean()),
        ("sqrt(max(time))", np.sqrt(10)),
        ("integral(level > 2)", 0.1 * (SWINGING[:-1] > 2).sum()),
        (
            "sum(max(level, 2, 2.1) - min(level, 2))",
            (np.maximum(SWINGING, 2.1) - np.minimum(SWINGING, 2)).sum(),
        ),
        ("max(peak_to_peak(level <= 2), 0)", 1.0),
        ("last(ref(level) + level)", 2 + SWINGING[-1]),
    ],
)
def test_a_formula_computes_what_it_says(text, expected):
    assert value(text) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("overshoot of level", "max(level) - ref(level)"),
        ("total move of valve", "sum(abs(diff(valve)))"),
        ("largest move of valve", "max(abs(diff(valve)))"),
    ],
)
def test_tracking_kpis_can_be_written_as_formulas(name, text):
    assert value(text) == pytest.approx(tracking_kpis(RUN)[name], rel=1e-12)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("1 / (first(level) - first(level))", np.inf),
        ("(0 - 1) ** 0.5 + last(level)", np.nan),
        ("9 ** 9 ** 9 ** 9 + last(level)", np.inf),
        ("max(level, after=20)", np.nan),
        ("max(load)", np.nan),
        ("last('tank.T' - ref('tank.T'))", np.nan),
    ],
)
def test_what_is_not_finite_is_data(text, expected):
    assert value(text) == pytest.approx(expected, nan_ok=True)


def test_a_run_without_a_record_has_no_kpis():
    kpis = Formulas((("peak", "max(level)", ""),))
    assert kpis(RUN.with_kpis({}))["peak"] == SWINGING.max()
    assert kpis(without_record(RUN)) == {}


def test_a_wrong_name_is_said_with_the_kpi_if_only_the_run_shows_it():
    with pytest.raises(ScenarioError, match=r"formula of KPI 'peak': signal 'levl': .*mean 'level'"):
        Formulas((("peak", "max(levl)", ""),))(RUN)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("max(levl)", r"signal 'levl': .* there are inputs 'valve'; outputs 'level'.*mean 'level'"),
        ("max(level - ref(valve))", "no output with a reference is called 'valve'; there are 'level'"),
        ("mx(level)", r"there is no function 'mx'\. Did you mean 'max'"),
        ("level - 2", r"is a curve: take its max"),
        ("max(2)", "max takes one signal"),
        ("max(level, until=2)", r"take after= and before=, too"),
        ("max(level, after=level)", r"take after= and before=, too"),
        ("diff(level, after=2)", "diff takes one signal"),
        ("ref(level + 1)", "ref takes one signal"),
        ("max(tank.T)", r"cannot hold 'tank\.T': .*in quotes"),
        ("max(level", "formula 'max\\(level': "),
        ("level == 2", "cannot hold"),
        ("0 < max(level) < 2", "cannot hold"),
        ("True", "cannot hold"),
        ("0.1", "formula '0.1' holds no signal"),
        ("2j", "cannot hold"),
        ("", "invalid syntax"),
        ("1" * 301, "at most 300 characters"),
        (3, "at most 300 characters of text, got 3"),
    ],
)
def test_a_wrong_formula_is_refused_in_clear_words(text, says):
    with pytest.raises(ScenarioError, match=says):
        value(text)


def test_names_are_checked_before_anything_runs():
    with pytest.raises(ScenarioError, match="Did you mean 'valve'"):
        conversion_of("max(valv)", "", RUN.channels, ())


OF_UNITS = Channels(
    x=(Channel("hot", "°C"), Channel("cold", "K"), Channel("n", "turns"), Channel("x")),
    u=(Channel("heat", "kW"),),
    y=(Channel("level", "m"),),
    time_unit="min",
)


@pytest.mark.parametrize(
    ("text", "unit", "one", "zero"),
    [
        ("integral(level > 2)", "s", 60, 0),
        ("last(time)", "h", 1 / 60, 0),
        ("max(level) - ref(level)", "mm", 1000, 0),
        ("max(hot)", "K", 1, 273.15),
        ("max(hot) - min(hot)", "K", 1, 0),
        ("peak_to_peak(hot)", "°C", 1, 0),
        ("max(abs(diff(hot)))", "°F", 1.8, 0),
        ("integral(heat)", "kWh", 1 / 60, 0),
        ("integral(heat)", "MJ", 0.06, 0),
        ("rms(heat, after=1) ** 2", "W²", 1e6, 0),
        ("max(level) / last(time)", "m/s", 1 / 60, 0),
        ("max(level) / ref(level)", "%", 100, 0),
        ("mean(n)", "turns", 1, 0),
        ("sum(level > 2)", "samples", 1, 0),  # a count has any name
        ("60 * integral(level > 2)", "s", 1, 0),  # converted by its author
        ("max(level) + 0.1 * rms(heat)", "points", 1, 0),
        ("max(level) + max(heat)", "points", 1, 0),  # a score of two things
        ("max(x)", "m", 1, 0),  # nothing says what it is in
        ("max(level)", "", 1, 0),
    ],
)
def test_a_formula_has_the_unit_of_its_signals_and_is_converted(text, unit, one, zero):
    found = conversion_of(text, unit, OF_UNITS, ())
    assert found.to(0.0) == pytest.approx(zero)
    assert found.to(1.0) - found.to(0.0) == pytest.approx(one)


@pytest.mark.parametrize(
    ("text", "unit", "says"),
    [
        ("integral(level > 2)", "m", "it gives min, which cannot be converted to m"),
        ("max(level)", "kW", "it gives m, which cannot be converted to kW"),
        ("max(n)", "rounds", "it gives turns, which cannot be converted to rounds"),
        ("max(hot - cold)", "K", "it adds or compares degC and K: convert one of them"),
        ("min(max(hot, cold))", "K", "it adds or compares degC and K: convert one of them"),
    ],
)
def test_a_formula_in_another_kind_of_unit_is_refused(text, unit, says):
    with pytest.raises(ScenarioError, match=says):
        conversion_of(text, unit, OF_UNITS, ())
    (problem,) = formula_problems([KPI("k", "k", unit, formula=text)], OF_UNITS, ())
    assert problem.startswith("formula of KPI 'k': it ")


@pytest.mark.parametrize(
    "text", ["max(level) ** 999999999", "2 ** 999999999 + max(level)", 30 * "(" + "max(level)" + 30 * "**4)"]
)
def test_to_follow_the_unit_of_a_formula_takes_neither_time_nor_memory(text):
    assert conversion_of(text, "m", OF_UNITS, ()).to(1.0) == 1.0


def test_the_value_of_a_formula_is_in_the_unit_of_its_kpi():
    run = replace(RUN, channels=replace(RUN.channels, time_unit="min"))
    assert Formulas((("late", "last(time)", "s"),))(run)["late"] == 60 * value("last(time)")


EVIL = [
    "__import__('os').system('x')",
    "level.__class__",
    "max(level).__class__.__mro__",
    "(lambda: 1)()",
    "[x for x in level]",
    "max(level)[0]",
    "f'{level}'",
    "(x := 1)",
    "max(*level)",
    "max(**level)",
    "open('x')",
    "eval('1')",
    "max(level, after=open('x'))",
    "ref(open('x'))",
    "{1: 2}",
    "level if level else level",
    "await level",
    "(yield)",
    "print",
    "max(open)",
    "not level",
    "level @ level",
    "level and level",
]
WORDS = [*"()+-*@<,.:[]{}'"]
WORDS += ["level", "valve", "2", "max", "abs", "ref", "(level)", "**", "after=", ":=", "for ", "in ", "f'"]
WORDS += ["__import__", "__class__", "open", "lambda", "'os'", "not ", "and "]


@pytest.mark.parametrize("text", EVIL)
def test_no_formula_reaches_python(text, monkeypatch):
    formula_of.cache_clear()
    with monkeypatch.context() as patched:
        refused = []
        for name in ("eval", "exec", "open", "__import__"):
            patched.setattr(builtins, name, lambda *a, **k: refused.append(a))
        with pytest.raises(ScenarioError):
            value(text)
        assert not refused


@given(st.lists(st.sampled_from(WORDS) | st.text(max_size=3), max_size=12).map("".join))
def test_any_text_is_refused_or_holds_nothing_but_arithmetic_of_signals(text):
    try:
        formula_of(text)
    except ScenarioError:
        return
    kinds = ast.Attribute | ast.Subscript | ast.Lambda | ast.comprehension | ast.JoinedStr | ast.NamedExpr
    for node in ast.walk(ast.parse(text.strip(), mode="eval")):
        assert not isinstance(node, kinds)
        if isinstance(node, ast.Call):
            assert isinstance(node.func, ast.Name)
            assert node.func.id in formula._FUNCTIONS


COARSE = recorded(
    [1.0], [0.0, 10.0, 20.0, 30.0], {"y": [0.0, 1.0, 2.0, 3.0]}, {"u": [0.0, 100.0, 100.0, 0.0]}
)
FINE = recorded([1.0], np.arange(10) * 0.1, {"y": np.arange(10.0)})


@pytest.mark.parametrize(
    ("run", "text", "expected"),
    [
        (COARSE, "integral(u, before=15)", 500.0),
        (COARSE, "integral(u, before=15) + integral(u, after=15)", 2000.0),
        (COARSE, "mean(u, after=12, before=18)", 100.0),
        (COARSE, "rms(u, after=5, before=15) ** 2", 5000.0),
        (COARSE, "mean(y, after=30)", 3.0),
        (COARSE, "mean(y, after=31)", np.nan),
        (FINE, "last(y, before=0.3)", 3.0),
        (FINE, "integral(y, before=0.25)", 0.3125),  # a line from 0 to 2.5
        (FINE, "rms(y, before=0.3) ** 2", 3.0),
    ],
)
def test_a_window_counts_inputs_as_steps_and_outputs_as_lines(run, text, expected):
    assert value_of(text, run) == pytest.approx(expected, rel=1e-12, nan_ok=True)


def test_an_output_is_what_is_measured_also_where_a_state_has_its_name():
    level = Channel("level", "m")
    run = replace(
        RUN,
        channels=Channels((level,), (), (level,)),
        x=np.zeros((101, 1)),
        u=RUN.u[:, :0],
        u_control=RUN.u_control[:, :0],
        y=SWINGING[:, None],
        y_ref=RUN.y_ref[:, :1],
    )
    assert value_of("max(level)", run) == SWINGING.max()


@pytest.mark.parametrize(
    ("limits", "aim"),
    [
        ({"at_most": 2.0}, 1.8),
        ({"at_most": 2.0, "better": "lower", "resolution": 0.01}, 1.8),
        ({"at_least": 45.0, "resolution": 0.1}, 49.5),
        ({"at_least": 0.6, "resolution": 0.001}, 0.66),
        ({"at_least": 6.0, "at_most": 12.0}, None),  # the middle of a range has room to both sides
        ({"at_most": 2.0, "better": "lower", "resolution": 0.5}, None),  # a tenth of it cannot be read
        ({"at_most": 0.0, "better": "lower"}, None),
        ({"better": "lower"}, None),
        ({"at_least": 1.0, "better": "lower"}, None),
        ({}, None),
    ],
)
def test_studies_aim_a_tenth_within_the_limit_of_a_margin(limits, aim):
    assert KPI("m", "margin", margin=True, **limits).aim == aim
    assert KPI("m", "no margin", **limits).aim is None
