"""Controllers as programs: the same moves sample by sample."""

import ctypes
import json
import re
import shutil
import subprocess
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given as drawn
from hypothesis import settings
from hypothesis import strategies as st

from prefcal_env import LQG, LQR, PID, Channel, FunctionPlant, LinearMPC, MPCSettings, Plant
from prefcal_env.controllers import Decentralized, Linearized, as_code, as_data, from_data
from prefcal_env.controllers.written import languages_of
from prefcal_env.errors import SettingsError
from prefcal_env.experiments.experiment import Channels, Controller, Measurement
from prefcal_env.qp import Tolerances

Step = Callable[[bool, float, float, float, float], float]
"""One sample of a program: automatic, input by hand, set point, measured output, what acted; to the input."""
COMPILER = shutil.which("cc")
NAMED = Channels((), (Channel("valve", "%"),), (Channel("T", "°C"),), "s")


# --- Run what was written.


def as_python(text: str) -> Step:
    """Return the function block of a structured text as a function, by the few statements that it uses."""
    constants = dict(re.findall(r"^  (\w+) : LREAL := (-?\d+\.\d+(?:e[+-]\d+)?);", text, re.MULTILINE))
    memory: dict[str, float] = {name.lower(): float(value) for name, value in constants.items()}
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
        else:
            lines.append("    " * depth + ("else:" if raw == "else" else f"if {_read(raw[3:-5])}:"))
            depth += 1
    space: dict[str, Callable[[dict[str, float]], None]] = {}
    exec("\n".join(lines), {}, space)

    def step(automatic: bool, hand: float, sp: float, pv: float, acted: float) -> float:
        memory.update(auto=automatic, hand=hand, sp=sp, pv=pv, acted=acted)
        space["block"](memory)
        return memory["u"]

    return step


def _read(value: str) -> str:
    return re.sub(r"(?<![\d.])\b(?!not\b)([a-z_]\w*)", r"m['\1']", value)


def compiled(folder: Path, controllers: Sequence[Any]) -> list[Any]:
    """Return each controller as a C function, with memory of its own before its other arguments."""
    if COMPILER is None:
        pytest.skip("no C compiler")
    wrapped = []
    for i, controller in enumerate(controllers):
        (folder / f"f{i}.h").write_text(as_code(controller, "c", NAMED, name=f"f{i}"))
        how = "double g{0}(f{0}_state *m, int a, double h, double r, double y, double u) "
        how += "{{ return f{0}(m, a, h, r, y, u); }}"
        if isinstance(controller, LinearMPC):
            how = "int g{0}(f{0}_state *m, int a, const double *h, const double *r, const double *x, "
            how += "const double *b, double *u) {{ return f{0}(m, a, h, r, x, b, u); }}"
        elif not isinstance(controller, PID):
            more, names = ("", "") if len(_vectors(controller)) < 3 else (", const double *b", ", b")
            how = f"void g{{0}}(f{{0}}_state *m, const double *r, const double *a{more}, double *u) "
            how += f"{{{{ f{{0}}(m, r, a{names}, u); }}}}"
        prototype = how.partition(" {{")[0] + ";"
        wrapped += [f'#include "f{i}.h"', prototype.format(i), how.format(i)]
    (folder / "all.c").write_text("\n".join([*wrapped, ""]))
    strict = ["-std=c99", "-Wall", "-Wextra", "-Wshadow", "-Wconversion", "-Werror", "-pedantic"]
    command = [
        str(COMPILER),
        *strict,
        "-ffp-contract=off",
        "-O1",
        "-shared",
        "-fPIC",
        "all.c",
        "-o",
        "all.so",
        "-lm",
    ]
    subprocess.run(command, check=True, cwd=folder)
    library = ctypes.CDLL(str(folder / "all.so"))
    return [getattr(library, f"g{i}") for i in range(len(controllers))]


def pid_step(function: Any) -> Step:
    function.restype = ctypes.c_double
    function.argtypes = [ctypes.c_void_p, ctypes.c_int, *[ctypes.c_double] * 4]
    memory = ctypes.create_string_buffer(64)
    return lambda *sample: float(function(memory, *sample))


def in_python(pid: PID) -> Step:
    """Return the PID itself; without a set point it hands the input through, here that by hand."""

    def step(automatic: bool, hand: float, sp: float, pv: float, acted: float) -> float:
        none, r = np.zeros(0), np.array([sp if automatic else np.nan])
        u = np.array([acted if automatic else hand])
        m = Measurement(t=0.0, x=none, u=u, y=np.array([pv]), d=none, y_ref=r)
        return min(max(float(pid.move(m).u[0]), pid.parameters["low"]), pid.parameters["high"])

    return step


def closed_loop(step: Step, seed: int, samples: int = 120) -> list[float]:
    """Return the inputs of a loop of a lag: noise, steps, hand operation and a slow, narrow actuator."""
    rng = np.random.default_rng(seed)
    gain, lag, y, u, sp, moves = rng.uniform(0.2, 3), rng.uniform(2, 40), 0.0, 5.0, 0.0, []
    manual = set(rng.integers(20, samples, 2).tolist())
    for k in range(samples):
        sp = rng.normal(0, 5) if rng.random() < 0.05 else sp
        automatic = not any(0 <= k - start < 8 for start in manual)
        asked = step(automatic, rng.normal(0, 30), sp, y, u)
        moves.append(asked)
        u = min(max(asked, u - 2.0), u + 2.0)
        y += (gain * u - y) / lag + rng.normal(0, 0.02)
    return moves


def tuned(draw: Callable[[float, float], float], often: Callable[[float], bool]) -> PID:
    """Return a random PID; some lack a part, a limit, or both signs of K_p."""
    low = -np.inf if often(0.2) else draw(-50, 0)
    return PID(
        draw(0.05, 5) * (-1 if often(0.5) else 1),
        np.inf if often(0.2) else draw(0.5, 100),
        0.0 if often(0.2) else draw(0, 10),
        T_s=draw(0.05, 5),
        N=draw(2, 20),
        b=draw(0, 1),
        c=float(often(0.3)),
        T_t=draw(1e-3, 50) if often(0.3) else None,
        low=low,
        high=np.inf if often(0.2) else max(low, -50.0) + draw(1, 100),
    )


def random_pid(seed: int) -> PID:
    rng = np.random.default_rng(seed)
    return tuned(lambda low, high: float(rng.uniform(low, high)), lambda share: bool(rng.random() < share))


@settings(max_examples=100)
@drawn(seed=st.integers(0, 2**31))
def test_structured_text_moves_as_the_pid_does(seed: int) -> None:
    pid = random_pid(seed)
    expected = closed_loop(in_python(pid), seed)
    found = closed_loop(as_python(as_code(pid, "st", NAMED)), seed)
    np.testing.assert_array_equal(found, expected)


def test_c_moves_as_the_pid_does(tmp_path: Path) -> None:
    pids = [random_pid(seed) for seed in range(100)]
    for seed, function in enumerate(compiled(tmp_path, pids)):
        expected = closed_loop(in_python(pids[seed]), seed)
        found = closed_loop(pid_step(function), seed)
        np.testing.assert_array_equal(found, expected)  # bit for bit: no multiply-add is fused


def programs(folder: Path, pid: PID) -> list[Step]:
    """Return the PID in structured text, and in C if it can be compiled here."""
    in_c = [] if COMPILER is None else [pid_step(compiled(folder, [pid])[0])]
    return [as_python(as_code(pid, "st", NAMED)), *in_c]


def test_a_position_that_reads_too_high_moves_nothing_in_manual(tmp_path: Path) -> None:
    for step in programs(tmp_path, PID(2.0, 20.0, T_s=1.0, low=0.0, high=100.0)):
        acted = 0.0
        for hand, u in [*[(40.0, 40.0)] * 50, (120.0, 100.0), (-3.0, 0.0)]:
            assert step(False, hand, 0.0, 0.0, acted + 1.0) == u
            acted = u


def test_the_first_automatic_move_starts_from_what_acted_and_follows_the_set_point(tmp_path: Path) -> None:
    for step in programs(tmp_path, PID(2.0, 20.0, 5.0, T_s=1.0, b=0.5)):
        step(False, 40.0, 7.0, 5.0, 40.0)
        assert step(True, 0.0, 5.0, 5.0, 40.0) == 40.0
        step(False, 40.0, 7.0, 5.0, 40.0)
        assert step(True, 0.0, 8.0, 5.0, 40.0) == pytest.approx(40.0 + 2.0 * 0.5 * 3.0)


def test_a_position_that_reads_too_high_leaves_the_stated_error(tmp_path: Path) -> None:
    # docs/on_the_plant.md: e = -bias T_i / (K_p T_t), here -1 * 20 / (2 * 5).
    for step in programs(tmp_path, PID(2.0, 20.0, T_s=1.0, T_t=5.0)):
        u = y = 0.0
        for _ in range(2000):
            u = step(True, 0.0, 3.0, y, u + 1.0)
            y += (u - y) / 10
        assert 3.0 - y == pytest.approx(-2.0)


# --- What control systems accept as structured text.

KEYWORDS = """
    function_block end_function_block var_input var_output var end_var constant bool lreal true false if not
    then else end_if
"""
LIBRARY = """
    sr rs sema r_trig f_trig ctu ctd ctud tp ton tof rtc integral derivative pid hysteresis ramp abs sqrt ln
    log exp sin cos tan limit max min sel mux add sub mul div gt ge eq le lt ne move
"""
"""Standard functions and blocks of IEC 61131-3 and its Annex F: no variable may be called like one."""


def test_structured_text_has_declared_words_only_and_none_of_the_standard_library() -> None:
    text = as_code(PID(2.0, 20.0, 2.0, T_s=1.0, low=0.0), "st", NAMED, name="Heater")
    plain = re.sub(r"\(\*.*?\*\)", "", text.lower(), flags=re.DOTALL)
    declared = set(re.findall(r"^  (\w+) :", plain, re.MULTILINE)) | {"heater"}
    used = set(re.findall(r"(?<![\w.])[a-z_]\w*", plain)) - set(KEYWORDS.split())
    assert used == declared  # and none is declared for nothing
    assert not used & set(LIBRARY.split())
    assert text.isascii()


def test_comments_say_what_to_connect_and_which_way_it_acts() -> None:
    text = as_code(PID(-2.0, 20.0, T_s=0.5, low=0.0, high=100.0), "st", NAMED, about="heater, experiment 3")
    assert text.startswith("(* heater, experiment 3\n")
    for words in (
        "measured output T [degC]",
        "input of the plant valve [%]",
        "sampling time of 0.5 s",
        "direct",
    ):
        assert words in text
    assert "reverse action" in as_code(PID(2.0, T_s=0.5), "c", NAMED)
    slow = as_code(PID(2.0, T_s=0.2), "st", replace(NAMED, time_unit="min"))
    assert "every sampling time of 0.2 min (12 s): its constants" in slow


@pytest.mark.parametrize("language", ["st", "c"])
def test_no_name_ends_a_comment_early(language: str) -> None:
    odd = replace(NAMED, y=(Channel("a*) b*/ (* /*\nc 温度/", "m·K*"),), u=(Channel("Öffnung", "°"),))
    text = as_code(PID(1.0, T_s=1.0), language, odd, about="x */ y *)\nz")
    opened, closed = ("(*", "*)") if language == "st" else ("/*", "*/")
    plain = as_code(PID(1.0, T_s=1.0), language, NAMED, about="x")
    assert text.count(opened) == text.count(closed) == plain.count(opened)
    assert text.isascii()
    assert "Offnung [deg]" in text
    assert "c __/ [m.K.]" in text  # two question marks and a slash would be a trigraph of C


def test_each_of_several_pids_has_a_block_of_its_own() -> None:
    pids = Decentralized([PID(1.0, T_s=1.0), PID(2.0, T_s=1.0, output=1, input=1)])
    two = replace(NAMED, u=(Channel("u1"), Channel("u2", "V")), y=(Channel("y1"), Channel("y2", "m")))
    text = as_code(pids, "st", two, name="loop")
    assert re.findall(r"FUNCTION_BLOCK (\w+)", text) == ["loop_1", "loop_2"]
    assert "measured output y2 [m]" in text


# --- LQR and LQG.


def random_lqr(rng: np.random.Generator, *, integral: bool, filtered: bool) -> LQR | LQG:
    """Return a regulator of a random plant with two states, inputs and outputs, around a state of rest."""
    A = rng.normal(0, 0.5, (2, 2)) - 0.5 * np.eye(2)
    D = np.zeros((2, 2)) if integral else rng.normal(0, 0.2, (2, 2))
    low = np.array([-1.5, -np.inf])
    m = Linearized(
        A, rng.normal(0, 1, (2, 2)), rng.normal(0, 1, (2, 2)), D, *rng.normal(0, 1, (3, 2)), low, low + 4
    )
    m = replace(m, low=m.u0 + low, high=m.u0 + np.array([2.0, 1.0]))
    more = {"integral": [1, 0], "Q_i": rng.uniform(0.1, 2, 2)} if integral else {}
    lqr = LQR(m, rng.uniform(0.1, 3, 2), rng.uniform(0.1, 3, 2), T_s=float(rng.uniform(0.02, 0.5)), **more)
    return LQG(lqr, noise=[0.1, 0.2], process=[0.3, 0.1]) if filtered else lqr


def _vectors(controller: LQR | LQG) -> list[str]:
    """Return what the C function takes before the inputs: references, then what was measured."""
    if isinstance(controller, LQG):
        return ["y_ref", "y", "u"]
    return ["y_ref", "y", "x"] if controller.integral else ["y_ref", "x"]


def regulated(controller: LQR | LQG, seed: int, function: Any = None, samples: int = 150) -> np.ndarray:
    """Return the inputs of a loop around the model, with noise, steps and a gain that is not the model's."""
    rng, lqr = np.random.default_rng(seed), controller.lqr if isinstance(controller, LQG) else controller
    m, T_s, u, dx, moves = lqr.model, lqr.T_s, lqr.model.u0, np.zeros(2), []
    r, memory = m.y0, ctypes.create_string_buffer(256)
    for k in range(samples):
        r = m.y0 + rng.normal(0, 2, 2) if rng.random() < 0.05 else r
        y = m.y0 + m.C @ dx + m.D @ (u - m.u0) + rng.normal(0, 0.02, 2)
        y_ref = np.where([False, lqr.integral != () and k % 50 > 40], np.nan, r)
        measured = Measurement(t=k * T_s, x=m.x0 + dx, u=u, y=y, d=np.zeros(0), y_ref=y_ref)
        u = (
            controller.move(measured).u
            if function is None
            else _called(function, controller, measured, memory)
        )
        moves.append(u)
        dx = dx + T_s * (m.A @ dx + 1.1 * m.B @ (u - m.u0))
    return np.array(moves)


def _called(function: Any, controller: LQR | LQG, measured: Measurement, memory: Any) -> np.ndarray:
    u = np.zeros(2)
    vectors = [np.ascontiguousarray(getattr(measured, name), dtype=float) for name in _vectors(controller)]
    function(memory, *(ctypes.c_void_p(each.ctypes.data) for each in (*vectors, u)))
    return u


@pytest.mark.parametrize("integral", [True, False])
@pytest.mark.parametrize("filtered", [True, False])
def test_c_moves_as_lqr_and_lqg_do(tmp_path: Path, integral: bool, filtered: bool) -> None:
    rng = np.random.default_rng([integral, filtered])
    regulators = [random_lqr(rng, integral=integral, filtered=filtered) for _ in range(12)]
    at_a_limit = 0
    for seed, (each, function) in enumerate(zip(regulators, compiled(tmp_path, regulators), strict=True)):
        found = regulated(each, seed, function)
        expected = regulated(each, seed)
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9)
        lqr = each.lqr if isinstance(each, LQG) else each
        at_a_limit += int(((expected == lqr.model.low) | (expected == lqr.model.high)).sum())
    assert at_a_limit > 100


# --- The MPC of a linear plant.


def random_mpc(rng: np.random.Generator, **changes: Any) -> LinearMPC:
    """Return an MPC of a random plant, often unstable, with limits of inputs, of moves or of outputs."""
    n_x, n_u, n_y = (int(n) for n in rng.integers(1, 4, 3))
    A = rng.normal(0, 0.6, (n_x, n_x)) - 0.4 * np.eye(n_x)
    D = rng.normal(0, 0.2, (n_y, n_u)) * (rng.random() < 0.3)
    rest = (rng.normal(0, 30, n_u), rng.normal(0, 30, n_y)) if rng.random() < 0.5 else None
    u0, y0 = rest or (np.zeros(n_u), np.zeros(n_y))
    N_p, given = int(rng.integers(2, 12)), dict[str, Any]()
    if rng.random() < 0.7:
        given |= {"du_min": -rng.uniform(0.05, 0.5, n_u), "du_max": rng.uniform(0.05, 0.5, n_u)}
    if rng.random() < 0.4:
        given |= {"y_min": np.where(rng.random(n_y) < 0.5, -np.inf, y0 - 0.5), "y_max": y0 + 0.7}
    if rng.random() < 0.3:
        given |= {"Q_u": 0.1 * np.eye(n_u), "u_ref": u0}
    plant = Plant.of(
        (A, rng.normal(0, 1, (n_x, n_u)), rng.normal(0, 1, (n_y, n_x)), D),
        inputs=[Channel(f"u{i}", low=u0[i] - 1, high=u0[i] + 0.8) for i in range(n_u)],
        rest=rest,
    )
    weights = {"Q_y": np.diag(rng.uniform(0.1, 3, n_y)), "Q_du": np.diag(rng.uniform(0.01, 1, n_u))}
    N_u = int(rng.integers(1, min(N_p, 4) + 1))
    return LinearMPC(
        plant, MPCSettings(float(rng.uniform(0.1, 0.8)), N_p, N_u, **weights, **given, **changes)
    )


def mpc_step(function: Any) -> Callable[..., tuple[np.ndarray, int]]:
    """Return one step of an MPC in C: the inputs, and what it returns."""
    memory = ctypes.create_string_buffer(100_000)

    def step(automatic: bool, *vectors: np.ndarray) -> tuple[np.ndarray, int]:
        hand, r, x, acted = (np.ascontiguousarray(each, dtype=float) for each in vectors)
        u = np.empty(len(acted))
        pointers = (ctypes.c_void_p(each.ctypes.data) for each in (hand, r, x, acted, u))
        return u, function(memory, int(automatic), *pointers)

    return step


def predictive_loop(mpc: LinearMPC, step: Any, seed: int, samples: int) -> tuple[float, int, int]:
    """Return the largest difference between both in one loop, the moves at a limit, and those by hand."""
    rng, plant, none = np.random.default_rng(seed), mpc.plant, np.zeros(0)
    u0, y0 = plant.rest or (np.zeros(len(plant.inputs)), np.zeros(len(plant.outputs)))
    low, high = (np.array([getattr(c, end) for c in plant.inputs]) for end in ("low", "high"))
    x, u, r, worst, limited, by_hand = np.zeros(len(plant.states)), u0, y0, 0.0, 0, 0
    for k in range(samples):
        r = y0 + rng.normal(0, 1.5, len(y0)) if k % 10 == 1 else r
        x = x + rng.normal(0, 0.05, len(x)) if np.abs(x).max() < 20 else rng.normal(0, 1, len(x))
        hand, automatic = u0 + rng.normal(0, 1, len(u)), k % 25 < 20
        made, how = step(automatic, hand, r, x, u)
        if automatic:
            move = mpc.move(Measurement(t=0.0, x=x, u=u, d=none, y_ref=r))
            assert move.solved == (how == 0)
            limited += int(how == 0 and bool(np.any((made <= low) | (made >= high))))
            expected = move.u
        else:
            expected, by_hand = np.clip(hand, low, high), by_hand + 1
        worst = max(worst, float(np.abs(made - expected).max()))
        # What acts may lie beyond the limits, as after a change of them.
        u = made + rng.normal(0, 0.4, len(u)) * (rng.random() < 0.1)
        x = plant.hold(x, u, none, np.array([mpc.T_s]))[0]
    return worst, limited, by_hand


@pytest.mark.parametrize("loops", [60, pytest.param(1000, marks=pytest.mark.campaign)])
def test_c_moves_as_the_mpc_does(tmp_path: Path, loops: int) -> None:
    mpcs = [random_mpc(np.random.default_rng([7, seed])) for seed in range(loops)]
    found = [
        predictive_loop(mpc, mpc_step(function), seed, 50)
        for seed, (mpc, function) in enumerate(zip(mpcs, compiled(tmp_path, mpcs), strict=True))
    ]
    worst, limited, by_hand = np.array(found).T
    print(f"largest difference {worst.max():.1e}, {limited.sum():.0f} moves at a limit")
    assert worst.max() <= 1e-9
    assert limited.sum() > 5 * loops
    assert by_hand.sum() == 10 * loops


def test_an_mpc_in_c_that_decides_nothing_holds_the_input_and_says_why(tmp_path: Path) -> None:
    lag = Plant.of(([1.0], [2.0, 1.0]), inputs=Channel("u", low=-1, high=1))
    short = MPCSettings(0.2, 10, 3, [[1.0]], [[1e-3]], tolerances=Tolerances(max_iterations=1))
    step = mpc_step(compiled(tmp_path, [LinearMPC(lag, short)])[0])
    zero, far, held = np.zeros(1), np.full(1, 1e3), np.full(1, 0.3)
    assert step(True, zero, far, zero, held) == (held, 2)  # three inputs reach their limits
    assert step(True, zero, np.full(1, np.nan), zero, held) == (held, 3)
    assert step(True, zero, zero, np.full(1, np.inf), held) == (held, 3)
    assert step(False, far, zero, np.full(1, np.nan), held) == (1.0, 0)
    assert step(False, np.full(1, np.nan), zero, zero, held)[1] == 3
    assert step(True, far, zero, zero, zero)[1] == 0


@pytest.mark.parametrize("seed", range(6))
def test_an_mpc_of_a_linear_plant_is_made_again_from_its_data(seed: int) -> None:
    mpc = random_mpc(np.random.default_rng([7, seed]))
    data = json.loads(json.dumps(as_data(mpc), allow_nan=False))
    text = as_code(from_data(data), "c", NAMED)
    assert text == as_code(mpc, "c", NAMED)


def test_a_number_in_the_data_of_an_mpc_is_no_matrix() -> None:
    data = as_data(LinearMPC(LAG, MPCSettings(0.2, 3, 1, [[1.0]], [[1.0]])))
    data["model"]["B"] = 3
    with pytest.raises(SettingsError, match=r"B must have shape \(1, 1\), got \(\)"):
        from_data(data)


@pytest.mark.parametrize(
    ("part", "changes", "words"),
    [
        ("settings", {"tolerances": {"absolute": 0.1, "relative": 0.1, "max_iterations": 10.5}}, "10.5"),
        ("model", {"D": []}, "D must be a matrix"),
        ("model", {"rest": [[1.0, 2.0], [0.0]]}, "the data of a LinearMPC do not fit"),
    ],
)
def test_what_does_not_fit_in_the_data_of_an_mpc_is_one_line(
    part: str, changes: dict[str, Any], words: str
) -> None:
    data = as_data(LinearMPC(LAG, MPCSettings(0.2, 3, 1, [[1.0]], [[1.0]])))
    data[part] |= changes
    with pytest.raises(SettingsError, match=words) as refused:
        from_data(data)
    assert "\n" not in str(refused.value)


def test_data_without_a_model_are_a_word_of_a_scenario_and_have_no_code() -> None:
    assert languages_of({"controller": "LinearMPC", "Q_y": 1.0}) == ()


@pytest.mark.parametrize("name", ["INFINITY", "isless", "fabsf", "sinl", "M_PI", "FP_NAN", "y0", "finite"])
def test_a_name_of_the_library_that_an_mpc_includes_is_refused(name: str) -> None:
    mpc = LinearMPC(LAG, MPCSettings(0.2, 3, 1, [[1.0]], [[1.0]]))
    with pytest.raises(SettingsError, match="name of a controller's code"):
        as_code(mpc, "c", NAMED, name=name)


def test_an_mpc_that_another_solver_solves_is_not_written() -> None:
    mpc = LinearMPC(LAG, MPCSettings(0.2, 3, 1, [[1.0]], [[1.0]], backend="piqp"))
    with pytest.raises(SettingsError, match="'active-set' only"):
        as_code(mpc, "c", NAMED)


def test_an_mpc_of_another_plant_says_why_it_has_neither_code_nor_data() -> None:
    tank = FunctionPlant(lambda x, u, d: u - x**2, states=[Channel("x")], inputs=[Channel("u")])
    disturbed = Plant.of(([[-1.0]], [[1.0, 1.0]], [[1.0]], [[0.0, 0.0]]), disturbances=["d"])
    far = Plant.of(([[9.0]], [[1.0]], [[1.0]], [[0.0]]))
    one = MPCSettings(0.5, 10, 2, [[1.0]], [[1.0]])
    for plant, given, words in (
        (tank, one, "not linear"),
        (disturbed, one, "measured disturbances"),
        (far, replace(one, y_max=[1.0]), "grows too fast"),
    ):
        with pytest.raises(SettingsError, match=words):
            as_code(LinearMPC(plant, given), "c", NAMED)
    with pytest.raises(SettingsError, match="not linear"):
        as_data(LinearMPC(tank, one))


# --- What cannot be written.


LAG = Plant.of(([1.0], [2.0, 1.0]))
DECLARED: Sequence[tuple[Controller, str]] = (
    (
        PID(1.0, T_s=1.0),
        """auto hand sp pv acted u gain weight_p weight_d per_sample tracking pole rise u_low u_high running
        last_sp last_pv i_part d_part wanted before m automatic integral derivative low high""",
    ),
    (
        LQR(LAG, [1.0], [1.0], T_s=0.1),
        """m acted nx nu ny ni k k_i u0 x0 y0 a b c d l f dx cut back finite sum step out time low high x y r
        u v e i j running""",
    ),
    (
        LinearMPC(LAG, MPCSettings(0.2, 3, 1, [[1.0]], [[1.0]])),
        """m automatic hand acted nx nu np ni n z mu p k row over under excess largest violation sign push
        partial full length norm slopes base offset most_up most_down turns back absolute relative out""",
    ),
)
"""Names within the programs of each controller."""
OTHERS = """
    double Real END_VAR END_IF var_temp end_program MOVE Class this nullptr pow copysign INT_TO_REAL while
    struct
"""


@pytest.mark.parametrize(
    "name", ["", "1st", "a b", "a__b", "a_", "x;y", "_a", *f"{KEYWORDS} {LIBRARY} {OTHERS}".split()]
)
@pytest.mark.parametrize("language", ["st", "c"])
def test_a_name_that_is_none_is_refused(name: str, language: str) -> None:
    with pytest.raises(SettingsError, match="name of a controller's code"):
        as_code(PID(1.0, T_s=1.0), language, NAMED, name=name)


@pytest.mark.parametrize(
    ("controller", "name"), [(controller, name) for controller, names in DECLARED for name in names.split()]
)
def test_a_name_within_the_program_of_the_controller_is_refused(controller: Controller, name: str) -> None:
    with pytest.raises(SettingsError, match="no name within the program"):
        as_code(controller, "c", NAMED, name=name)


@pytest.mark.parametrize(
    "name",
    [
        *["Heater", "loop", "valve_7", "T", "pid1", "flow_to_tank", "state", "ending"],
        *["base", "norm", "row", "push", "full"],  # of an MPC's program only
    ],
)
def test_other_names_are_taken(name: str) -> None:
    assert f"FUNCTION_BLOCK {name}\n" in as_code(PID(1.0, T_s=1.0), "st", NAMED, name=name)


def test_what_has_no_such_form_says_why() -> None:
    class Other:
        T_s = 1.0

        def move(self, measurement: Measurement) -> Any: ...

    lqr = LQR(Plant.of(([1.0], [1, 1])), [1.0], [1.0], T_s=0.1)
    with pytest.raises(SettingsError, match=r"\['c', 'st'\], got 'ld'"):
        as_code(lqr, "ld", NAMED)
    with pytest.raises(SettingsError, match="in C only"):
        as_code(lqr, "st", NAMED)
    with pytest.raises(SettingsError, match=r"type Other cannot be written as code.*LinearMPC"):
        as_code(Other(), "c", NAMED)
