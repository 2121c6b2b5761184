"""A PID in other forms and languages: the same numbers, and the same moves sample by sample."""

import ctypes
import re
import shutil
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from prefcal_env import PID
from prefcal_env.controllers.written import c_code, forms, structured_text
from prefcal_env.errors import SettingsError
from prefcal_env.experiments.experiment import Measurement

Step = Callable[[bool, float, float, float], float]
"""One sample of a program: automatic, set point, measured output and the input that acted, to the input."""
COMPILER = shutil.which("cc")


# --- Run what was written.


def as_python(text: str) -> Step:
    """Return the function block of a structured text as a function, by the few statements that it uses."""
    constants = dict(re.findall(r"^  (\w+) : LREAL := ([-\d.e+]+);", text, re.MULTILINE))
    memory = {name.lower(): float(value) for name, value in constants.items()}
    memory |= {"running": False, "true": True, "false": False}
    body = re.sub(r"\(\*.*?\*\)", "", text.rpartition("END_VAR")[2], flags=re.DOTALL)
    lines, depth = ["def block(m):"], 1
    for raw in filter(None, map(str.strip, body.lower().splitlines())):
        if raw in ("end_if;", "end_function_block"):
            depth -= 1
            continue
        if raw == "else":
            depth -= 1
        name, assigned, value = raw.rstrip(";").partition(" := ")
        if assigned:
            lines.append("    " * depth + f"m[{name!r}] = {_read(value)}")
        elif raw == "return;":
            lines.append("    " * depth + "return")
        else:
            lines.append("    " * depth + ("else:" if raw == "else" else f"if {_read(raw[3:-5])}:"))
            depth += 1
    space: dict[str, Callable[[dict[str, float]], None]] = {}
    exec("\n".join(lines), {"limit": lambda low, value, high: min(max(value, low), high)}, space)

    def step(automatic: bool, sp: float, pv: float, acted: float) -> float:
        memory.update(auto=automatic, sp=sp, pv=pv, acted=acted)
        space["block"](memory)
        return memory["u"]

    return step


def _read(value: str) -> str:
    words = r"(?<![\d.])\b(?!not\b|limit\b)([a-z_]\w*)"
    return re.sub(words, r"m['\1']", value)


@pytest.fixture(scope="module")
def compiled(tmp_path_factory: pytest.TempPathFactory) -> Callable[[PID], Step]:
    if COMPILER is None:
        pytest.skip("no C compiler")
    folder = tmp_path_factory.mktemp("c")
    count: Iterator[int] = iter(range(10_000))
    return lambda pid: _compile(pid, folder / f"p{next(count)}")


def _compile(pid: PID, path: Path) -> Step:
    path.with_suffix(".c").write_text(c_code(pid))
    strict = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-ffp-contract=off", "-O1"]
    library = path.with_suffix(".so")
    subprocess.run(
        [str(COMPILER), *strict, "-shared", "-fPIC", str(path.with_suffix(".c")), "-o", str(library)],
        check=True,
    )
    function = ctypes.CDLL(str(library)).tuned_pid
    function.restype = ctypes.c_double
    function.argtypes = [ctypes.c_void_p, ctypes.c_int, *[ctypes.c_double] * 3]
    memory = ctypes.create_string_buffer(64)
    return lambda automatic, sp, pv, acted: float(function(memory, automatic, sp, pv, acted))


def in_python(pid: PID) -> Step:
    """Return the PID itself; without a set point it hands the input through."""

    def step(automatic: bool, sp: float, pv: float, acted: float) -> float:
        none, r = np.zeros(0), np.array([sp if automatic else np.nan])
        m = Measurement(t=0.0, x=none, u=np.array([acted]), y=np.array([pv]), d=none, y_ref=r)
        return float(pid.move(m).u[0])

    return step


def closed_loop(step: Step, seed: int, samples: int = 120) -> list[float]:
    """Return the inputs of a loop of a lag: noise, steps, hand operation and a slow, narrow actuator."""
    rng = np.random.default_rng(seed)
    gain, lag, y, u, sp, moves = rng.uniform(0.2, 3), rng.uniform(2, 40), 0.0, 5.0, 0.0, []
    manual = set(rng.integers(20, samples, 2).tolist())
    for k in range(samples):
        sp = rng.normal(0, 5) if rng.random() < 0.05 else sp
        automatic = not any(0 <= k - start < 8 for start in manual)
        asked = step(automatic, sp, y, u)
        moves.append(asked)
        u = min(max(asked, u - 2.0), u + 2.0)
        y += (gain * u - y) / lag + rng.normal(0, 0.02)
    return moves


tunings = st.builds(
    lambda K, T_i, T_d, T_s, N, b, c, low, width: PID(
        K, T_i, T_d, T_s=T_s, N=N, b=b, c=c, low=low, high=max(low, -50.0) + width
    ),
    st.floats(0.05, 5) | st.floats(-5, -0.05),
    st.floats(0.5, 100) | st.just(np.inf),
    st.floats(0, 10),
    st.floats(0.05, 5),
    st.floats(2, 20),
    st.floats(0, 1),
    st.sampled_from([0.0, 1.0]),
    st.floats(-50, 0) | st.just(-np.inf),
    st.floats(1, 100),
)


@settings(max_examples=100)
@given(pid=tunings, seed=st.integers(0, 2**31))
def test_structured_text_moves_as_the_pid_does(pid: PID, seed: int) -> None:
    expected = closed_loop(in_python(pid), seed)
    found = closed_loop(as_python(structured_text(pid)), seed)
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9)


def test_c_moves_as_the_pid_does(compiled: Callable[[PID], Step]) -> None:
    tuned = [
        PID(2.0, 20.0, 2.0, T_s=1.0, b=0.8, low=-3.0, high=8.0),
        PID(-0.3, np.inf, 0.0, T_s=0.1),
        PID(1.5, 4.0, 3.0, T_s=0.5, N=4.0, c=1.0, T_t=1e-3, high=6.0),
    ]
    for seed, pid in enumerate(tuned):
        expected = closed_loop(in_python(pid), seed)
        np.testing.assert_allclose(closed_loop(compiled(pid), seed), expected, rtol=1e-9, atol=1e-9)


# --- The numbers.


def response(form: str, numbers: dict[str, float], s: complex) -> complex:
    n = numbers
    if form.startswith("parallel"):
        return n["K_p"] + n["K_i"] / s + n["K_d"] * s
    if form.startswith("series"):
        return n["K'"] * (1 + 1 / (n["T_i'"] * s)) * (1 + n["T_d'"] * s)
    return n["K_p"] * (1 + 1 / (n["T_i"] * s) + n["T_d"] * s)


def test_all_forms_are_the_same_controller() -> None:
    found = forms(PID(-1.2, 50.0, 9.0, T_s=1.0))
    by_name = {f.name: {n.symbol: n.value for n in f.numbers} for f in found}
    assert len(by_name) == 3
    for omega in (1e-3, 0.1, 5.0):
        values = [response(name, numbers, 1j * omega) for name, numbers in by_name.items()]
        np.testing.assert_allclose(values, values[0], rtol=1e-12)


def test_series_form_needs_an_integral_time_of_four_derivative_times() -> None:
    (series,) = [f for f in forms(PID(1.0, 30.0, 9.0, T_s=1.0)) if f.name.startswith("series")]
    assert series.numbers == ()
    assert "quarter" in series.lacks


def test_percent_band_and_repeats_per_minute() -> None:
    # 4 %/K over 50 K and 100 %: 2 % a %, a band of 50 %; 2 min a repeat.
    found = forms(PID(4.0, 2.0, 0.0, T_s=0.1, low=0.0, high=100.0), gain="%/K", time="min", span=50.0)
    values = {n.symbol: (n.value, n.unit) for f in found for n in f.numbers}
    assert values["K"] == (2.0, "%/%")
    assert values["PB"] == (50.0, "%")
    assert values["1/T_i"] == (0.5, "1/min")


@pytest.mark.parametrize("name", ["", "1st", "a b", "double", "Real", "END_VAR", "a__b", "a_", "x;y"])
def test_a_name_that_is_none_is_refused(name: str) -> None:
    with pytest.raises(SettingsError, match="name of a controller's code"):
        structured_text(PID(1.0, T_s=1.0), name)
    with pytest.raises(SettingsError, match="name of a controller's code"):
        c_code(PID(1.0, T_s=1.0), name)


@pytest.mark.parametrize("span", [0.0, -1.0, np.inf, np.nan])
def test_a_range_that_is_none_is_refused(span: float) -> None:
    with pytest.raises(SettingsError, match="range of the measured output"):
        forms(PID(1.0, T_s=1.0), span=span)


def test_a_unit_that_is_no_time_is_refused() -> None:
    with pytest.raises(SettingsError, match="unit of time"):
        forms(PID(1.0, T_s=1.0), time="bar")
