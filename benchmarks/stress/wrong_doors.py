"""Make random wrong inputs for the commands, for `wrong_inputs.py`: each is wrong by how it is made."""

import contextlib
import io
import json
import random
import sys
import tempfile
import zipfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple
from unittest import mock

import pandas as pd

from prefcal_app.__main__ import main as prefcal
from prefcal_env import LQR, PID, LinearMPC, MPCSettings, Plant
from prefcal_env.controllers import as_data
from prefcal_env.experiments.experiment import Controller

Dice = random.Random


class Said(NamedTuple):
    """How an input ended: exit code, what was said of it, and what came on standard output."""

    code: int
    words: str
    out: str = ""


@dataclass(frozen=True)
class Wrong:
    """An input that is wrong by how it is made."""

    call: Callable[[Path], Said]  # what takes it, in a folder of its own; it raises what nothing handled
    about: str  # the input, to print
    # Words of which one must be in what is said, in any case; any words do if there are none
    named: Sequence[str] = ()
    files: Mapping[str, bytes] = field(default_factory=dict)  # files that are there before
    # Exit codes of which one is expected; 0 is for what is harmless by a promise
    codes: Sequence[int] = (1, 2)
    # Whether what is wrong is told on standard output among what is right, as `check` does
    told: bool = False


def command(words: Sequence[str]) -> Callable[[Path], Said]:
    """Return what runs `prefcal` with these words, without a terminal."""

    def call(folder: Path) -> Said:
        out, err, code = io.StringIO(), io.StringIO(), 0
        with (
            mock.patch.object(sys, "argv", ["prefcal", *words]),
            mock.patch.object(sys, "stdin", io.StringIO()),
            contextlib.redirect_stdout(out),
            contextlib.redirect_stderr(err),
            contextlib.chdir(folder),
        ):
            try:
                prefcal()
            except SystemExit as end:
                code = end.code if isinstance(end.code, int) else int(end.code is not None)
        return Said(code, err.getvalue(), out.getvalue())

    return call


def typed(
    *words: str, named: Sequence[str] = (), files: Mapping[str, bytes] | None = None, **more: Any
) -> Wrong:
    """Return a wrong command line, with its files."""
    return Wrong(command(words), " ".join(map(repr, words)), named, files or {}, **more)


# --- What is wrong wherever it stands.

JUNK = ("", " ", "abc", "1e", "--", "NaNs", "\u212b\u0130", "0x1G", "1,5,", "[", "'", "=", "None", "9" * 400)
"""Words that are no number."""
_KINDS: tuple[Any, ...] = (None, True, 3, -1.5, "abc", [], {}, [1, "a"], {"a": 1}, "x" * 3000)


def word(dice: Dice) -> str:
    """Return a word that is no name of anything."""
    return "q" + "".join(dice.choice("bcdfghjkmpqstvwxz") for _ in range(dice.randint(4, 9)))


def other(dice: Dice, value: Any) -> Any:
    """Return a value of another type."""
    numbers = (bool, int, float)
    kind = numbers if isinstance(value, numbers) else type(value)
    return dice.choice([each for each in _KINDS if not isinstance(each, kind)])


def noise(dice: Dice, count: int = 200) -> bytes:
    """Return bytes that are no text and no file of any format."""
    return b"\x81\xff\x00" + dice.randbytes(dice.randint(0, count))


def leaves(value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Yield the path of everything in plain data."""
    inner = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, each in inner:
        yield (*path, key)
        yield from leaves(each, (*path, key))


def at(value: Any, path: Sequence[Any]) -> Any:
    """Return what stands at a path."""
    for key in path:
        value = value[key]
    return value


def with_other(dice: Dice, plain: Any, path: Sequence[Any]) -> tuple[Any, Any]:
    """Return plain data with a value of another type at a path, and that value."""
    changed = json.loads(json.dumps(plain))
    new = other(dice, at(plain, path))
    at(changed, path[:-1])[path[-1]] = new
    return changed, new


def damaged(dice: Dice, content: bytes) -> bytes:
    """Return a file that no longer is one: cut off, overwritten at its start, or something else."""
    cut = content[: dice.randint(1, max(len(content) * 9 // 10, 1))]
    return dice.choice([cut, noise(dice) + content[200:], noise(dice), b"[" * 100_000, b'{"a":' * 50_000])


# --- Options and values of the commands.

_QUICK = ("--calibrator", "ideal", "--simulate", "0", "--n-max", "2")
_LIMITS: Mapping[str, tuple[str, ...]] = {
    "--n-max": ("0", "-3", "10001"),
    "--n-init": ("0", "-1", "7"),
    "--seed": ("-1", str(2**63), "1.5"),
    "--simulate": ("-1", "100001", "0.5"),
    "--port": ("-1", "65536"),
    "--at-once": ("0", "257", "-1"),
    "--questions-per-experiment": ("0", "-1", "100"),
    "--run-timeout": ("0", "-1", "nan"),
}
RUNS: Mapping[str, bytes] = {
    "a.csv": b"time [s],level [m],valve [%]\n" + b"".join(b"%d,%d.5,%d\n" % (k, k, 9 * k) for k in range(9)),
    "b.csv": b"time [s],level [m],valve [%]\n" + b"".join(b"%d,%d.1,%d\n" % (k, k, 8 * k) for k in range(9)),
}
_PID = (
    b"from prefcal_env import Channel, FunctionPlant\n"
    b"plant = FunctionPlant(lambda x, u, d: [0.004 * u[0] - 0.1 * max(x[0], 0.0) ** 0.5],\n"
    b"    states=[Channel('level', 'm', target=2.0)], inputs=[Channel('valve', '%', low=0, high=100)],\n"
    b"    time_unit='s')\n"
)


def options(dice: Dice) -> Wrong:
    """Return a wrong option, value, name, or number of words."""
    return dice.choice([_number, _name, _knob, _pair, _unknown, _too_many, _elsewhere])(dice)


def _number(dice: Dice) -> Wrong:
    option = dice.choice(sorted(_LIMITS))
    value = dice.choice([*_LIMITS[option], *JUNK[2:]])
    quick = _QUICK if option not in _QUICK else ("--calibrator", "ideal", "--simulate", "0")
    agent = ("--agent", "glisp") if option in ("--at-once", "--questions-per-experiment") else ()
    return typed("calibrate", "lag", *quick, *agent, option, value, named=(option, value[:40]))


def _name(dice: Dice) -> Wrong:
    option, name = (
        dice.choice(["--calibrator", "--agent", "--taste", "--twin", "--config", "--cost"]),
        word(dice),
    )
    rest = {
        "--twin": ("--simulate", "9", "--n-max", "2"),
        "--agent": ("--calibrator", "ideal", "--n-max", "2"),
    }
    cost = ("--calibrator", "synthetic", "--simulate", "0", "--n-max", "2")
    quick = (
        cost if option == "--cost" else rest.get(option, _QUICK[2:] if option == "--calibrator" else _QUICK)
    )
    name = dice.choice([name, f"{name}.json", f"{name}.py:{name}"])
    return typed("calibrate", "lag", *quick, option, name, named=(option, name, name.partition(":")[0]))


def _knob(dice: Dice) -> Wrong:
    junk, name = dice.choice(JUNK[2:]), word(dice)
    spec = dice.choice(
        [
            "K_p",
            "K_p=",
            "K_p=1",
            "=1:2",
            f"K_p={junk}:2 %/m",
            f"K_p=1:{junk} %/m",
            "K_p=5:1 %/m",
            "K_p=0:5:log %/m",
            "K_p=-1:5:log %/m",
            f"K_p=1:5:{name} %/m",
            f"K_p=1:2 {name}",
            f"{name}=1:2 %/m",
            "K_p=nan:2 %/m",
            "K_p=1:inf %/m",
            "K_p=0.2:0.8:int %/m",
        ]
    )
    words = ("check", "pid", "--plant", "model.py:plant", "--knob", spec)
    return typed(*words, named=(spec[:40], "K_p", name), files={"model.py": _PID}, told=True)


def _pair(dice: Dice) -> Wrong:
    name, junk = word(dice), dice.choice(JUNK[2:])
    option, value = dice.choice(
        [
            ("--start", f"{name}=3"),
            ("--start", f"K={junk}"),
            ("--start", "K=1"),
            ("--start", f"{name}:3"),
            ("--start", f"{name}"),
            ("--start", f"K={10 ** dice.randint(4, 400)}, T_i=9, T_d=1, T_f=1, b=1, T_t=9"),
            ("--reference", f"{name}=3"),
            ("--show", name),
            ("--stop-time", dice.choice(["-1", "0", "nan", "inf", junk])),
            ("--plant", f"{name}.py:x"),
            ("--knob", f"{name}=1:2"),
        ]
    )
    return typed("calibrate", "lag", *_QUICK, option, value, named=(option, value[:40], name, "knob 'K'"))


def _unknown(dice: Dice) -> Wrong:
    name, verb = word(dice), dice.choice(["calibrate", "check", "choose", "look", "report", "verify", "new"])
    words = dice.choice(
        [(f"{verb}{name}",), (verb, f"--{name}"), (verb, "x", f"--{name}=3"), ("studies", name)]
    )
    return typed(*words, named=(name,))


def _too_many(dice: Dice) -> Wrong:
    name = word(dice)
    words = [
        ("calibrate", "lag", name),
        ("check", "lag", name),
        ("choose", "a.csv", name),
        ("verify", "a.json", name),
        ("new", "rig", "a.toml", name),
        ("report", "a", name),
        ("scenarios", name),
        ("studies", "show", "a", name),
        ("studies", "rename", "a", "b", name),
    ]
    return typed(*dice.choice(words), named=(name,), files=RUNS)


def _elsewhere(dice: Dice) -> Wrong:
    name, junk = word(dice), dice.choice(JUNK[2:])
    path = dice.choice(
        [name, f"{name}.py:x", f"{name}.toml", f"{name}/{name}", "a" * 300, f"{name}.fmu", "a\tb\x07"]
    )
    words, named = dice.choice(
        [
            (("calibrate", path), (path[:40].removesuffix(":x"), "\\x07")),
            (("check", "lag", "--theta", f"K={junk}"), (junk[:40], "K", "theta")),
            (("check", "lag", "--theta", f"{name}=1"), (name,)),
            (("check", "lag", "--out", f"{name}/{name}.png"), (name,)),
            (("check", "lag", "--out", f"x.{name}"), (name, "png")),
            (("new", name), (name,)),
            (("new", "rig", "a.csv"), ("a.csv",)),
            (("report", path), (path[:40], "\\x07")),
            (("verify", path), (path[:40], "\\x07", "best.json")),
            (
                ("studies", dice.choice(["show", "verify", "export", "delete", "import"]), path),
                (path[:40], "a b"),  # a name is printed on one line
            ),
            (("studies", "rename", name, "b"), (name,)),
            (("look", "a.csv", path), (path[:40], "\\x07")),
            (("look", "a.csv"), ("two",)),
        ]
    )
    return typed(*words, named=named, files=RUNS)


# --- Scenario files and own Python files.

RIG: dict[str, Any] = {
    "title": "Heating an oven",
    "brief": "Heat it to 200 °C.",
    "show": ["temperature", "power"],
    "rig": {
        "instructions": "Start the logger.",
        "time_unit": "min",
        "outputs": {"temperature": {"unit": "°C", "band": 2, "sensor": [0, 400]}},
        "inputs": {"power": {"unit": "%", "low": 0, "high": 100}},
    },
    "reference": {"temperature": 200},
    "kpis": {
        "overshoot of temperature": 5,
        "late": "rms(temperature - ref(temperature), after=2)",
        "heat": {"formula": "integral(power)", "unit": "% min", "at_most": 90, "title": "heat"},
    },
    "panels": {"power": {"title": "power", "low": 0, "high": 100}},
    "knobs": {
        "K_p": "0.5:20:log %/K",
        "K_i": {"low": 0.01, "high": 2, "unit": "%/(K min)", "scale": "log10"},
    },
    "starts": {"now": {"K_p": 2, "K_i": 0.1}},
}
"""A scenario file that is right, as plain data."""
_FORMULAS = (
    "max(",
    "max(nosuch)",
    "__import__('os').system('true')",
    "temperature.real",
    "9 ** 9 ** 9 ** 9",
    "(" * 500 + "temperature" + ")" * 500,
    "max(temperature, after='x')",
    "max(temperature, after=2, after=3)",
    "lambda: 3",
    "temperature",
    "max(temperature) - power",
    "ref(power)",
    "max()",
    "1 if power else 2",
    "max(temperature) +",
    "[max(power)]",
    "f'{power}'",
    "max(powеr)",  # with a letter of another alphabet
    "",
)


def toml(value: Any) -> str:
    """Return plain data in TOML, tables inline below the first level."""
    if isinstance(value, dict):
        return (
            "{ "
            + ", ".join(f"{json.dumps(k, ensure_ascii=False)} = {toml(v)}" for k, v in value.items())
            + " }"
        )
    if isinstance(value, list):
        return f"[{', '.join(map(toml, value))}]"
    return "nan" if value is None else json.dumps(value, ensure_ascii=False)


def described(plain: Mapping[str, Any]) -> str:
    """Return a scenario file."""
    return "".join(f"{json.dumps(key, ensure_ascii=False)} = {toml(value)}\n" for key, value in plain.items())


_MAY_BE_LEFT_OUT = {"kpis"}  # `kpis = "none"` apart, whatever is there has one type
_WRONG_VALUES: tuple[tuple[tuple[str, ...], tuple[Any, ...]], ...] = (
    (("rig", "time_unit"), ("parsec", "", "kg")),
    (("rig", "outputs", "temperature", "band"), (-1,)),
    (("rig", "outputs", "temperature", "sensor"), ([400, 0], [0], [0, 1, 2], ["a", 1])),
    (("rig", "inputs", "power", "low"), (100, 1e9)),
    (("reference", "temperature"), (None, [1], "hot")),
    (("reference", "power"), (3,)),
    (("kpis", "heat", "unit"), ("furlong", "kg", "°C")),
    (("kpis", "heat", "better"), ("sideways", 3)),
    (("kpis", "heat", "formula"), _FORMULAS),
    (("kpis", "late"), _FORMULAS),
    (("kpis", "no such KPI"), (3,)),
    (("knobs", "K_p"), ("5:1", "1", "a:b", "0:5:log", "1:2:qux %", "", ":", "1:2:log:log:int:5")),
    (("knobs", "K_i", "low"), (5, None)),
    (("knobs", "K_i", "scale"), ("log11",)),
    (("knobs", "K_i", "step"), (-1, 1e9)),
    (("starts", "now", "K_p"), (1e9, None, "two")),
    (("starts", "now", "K_z"), (1,)),
    (("panels", "power", "low"), (200,)),
    (("panels", "nosuch"), ({"low": 1},)),
    (("show",), (["nosuch"],)),
    # A whole number that no float holds.
    (("rig", "outputs", "temperature", "band"), (10**400,)),
    (("rig", "outputs", "temperature", "sensor"), ([0, 10**400],)),
    (("rig", "inputs", "power", "high"), (10**400,)),
    (("reference", "temperature"), (10**400, -(10**400))),
    (("kpis", "heat", "at_most"), (10**400, "many")),
    (("kpis", "overshoot of temperature"), (10**400,)),
    (("panels", "power", "high"), (10**400,)),
    (("knobs", "K_i", "high"), (10**400,)),
    (("knobs", "K_i", "step"), (10**400,)),
    (("starts", "now", "K_p"), (10**400,)),
    (("rig", "max_rows"), (10**400, 3, -1)),
    (("rig", "max_gap"), (10**400, -1, "long")),
)


def files(dice: Dice) -> Wrong:
    """Return a wrong scenario file."""
    how, name = dice.randrange(5), word(dice)
    plain = json.loads(json.dumps(RIG))
    if how == 0:  # a key that is none
        tables = [path for path in leaves(plain) if isinstance(at(plain, path), dict)]
        tables = [p for p in tables if p[0] not in ("panels", "starts", "reference") and p != ("knobs",)]
        path = dice.choice([(), *tables])
        at(plain, path)[name] = 3 if path != ("kpis",) else {"at_most": 3}
        named: tuple[str, ...] = (name,)
    elif how == 1:  # a value of another type
        path = dice.choice([p for p in leaves(plain) if p[0] not in _MAY_BE_LEFT_OUT])
        plain, _ = with_other(dice, plain, path)
        named = tuple(str(key) for key in path[-3:])
    elif how == 2:  # a value that cannot be
        path, values = dice.choice(_WRONG_VALUES)
        at(plain, path[:-1])[path[-1]] = dice.choice(values)
        named = (*path[-2:], "nosuch")
    elif how == 3:  # what must be there is not
        path = dice.choice([("knobs",), ("rig",), ("rig", "outputs"), ("knobs", "K_i", "low")])
        del at(plain, path[:-1])[path[-1]]
        named = (path[-1],)
    text = described(plain).encode()
    if how == 4:  # no TOML
        lines, junk = (
            text.splitlines(keepends=True),
            dice.choice([b"= 3\n", b"[[[\n", b"a b\n", b"x = \n", b"\xff\n"]),
        )
        place = dice.randrange(len(lines) + 1)
        text = dice.choice([b"".join([*lines[:place], junk, *lines[place:]]), text + lines[0], noise(dice)])
        named = ("rig.toml",)
    words = dice.choice([("check", "rig.toml"), ("calibrate", "rig.toml", "--calibrator", "ideal")])
    return typed(*words, named=named, files={"rig.toml": text}, told=words[0] == "check")


OWN = """\
import numpy as np
from prefcal_env import Knob, KnobSpace, recorded
from prefcal_scenarios import KPI, Scenario
K_p, T_i = Knob("K_p", 1, 500, "%/m"), Knob("T_i", 2, 200, "s")
def run(theta, seed=0):
    t = np.arange(0.0, 9.0, 0.5)
    level = theta[0] * t
    return recorded(theta, t, {"level": level}, {"valve": level}, {"level": 2.0},
        units={"level": "m", "valve": "%"})
scenario = Scenario("own", "Level of a tank", KnobSpace([K_p, T_i]), run, simulated=True)
"""
"""An own file that is right."""
_CHANGES: tuple[tuple[str, str], ...] = (
    ("return recorded", "return ("),
    ("import numpy", "import nosuchmodule_qx\nimport numpy"),
    ("import numpy", "raise RuntimeError('qx')\nimport numpy"),
    ("import numpy", "raise SystemExit('qx')\nimport numpy"),
    ("import numpy", "1 / 0\nimport numpy"),
    ("scenario = ", "scenery = "),
    ("scenario = Scenario(", "scenario = dict("),
    ("scenario = Scenario(", "scenario = 3 or Scenario("),
    ('"K_p", 1, 500', '"K_p", 500, 1'),
    ('"K_p", 1, 500', '"K_p", "a", 500'),
    ('"K_p", 1, 500', '"T_i", 1, 500'),
    ('"K_p", 1, 500, "%/m"', '"K_p", 1, 500, 3'),
    ("KnobSpace([K_p, T_i])", "KnobSpace([])"),
    ("KnobSpace([K_p, T_i])", "3"),
    ("KnobSpace([K_p, T_i])", "[K_p, T_i]"),
    (", run, simulated", ", None, simulated"),
    (", run, simulated", ", 'run', simulated"),
    ("simulated=True", "simulatd=True"),
    ("simulated=True", "kpis=(3,)"),
    ("simulated=True", "kpis=(KPI('a', 'b', 'm', formula='max(nosuch)'),)"),
    ("simulated=True", "kpis=(KPI('a', 'b', 'm', at_most='x'),)"),
    ("simulated=True", "kpis=(KPI('a', 'b', 'qparsec', formula='max(level)'),)"),
    ("simulated=True", "cost=3"),
    ("simulated=True", "references={'now': [1]}"),
    ("simulated=True", "panels=('level',)"),
    ("return recorded", "return 3\n    return recorded"),
    ("return recorded", "return None\n    return recorded"),
    ("return recorded", "return theta\n    return recorded"),
    ("return recorded", "raise ValueError('qx')\n    return recorded"),
    ("return recorded", "raise SystemExit(3)\n    return recorded"),
    ("return recorded", "import os; os._exit(3)\n    return recorded"),
    ("return recorded", "import os; os.kill(os.getpid(), 9)\n    return recorded"),
    ("return recorded", "theta[0] = 1\n    return recorded"),
    ("return recorded", "raise MemoryError\n    return recorded"),
    ("return recorded", "raise BaseException('qx')\n    return recorded"),
    ("return recorded", "return run(theta)\n    return recorded"),
    ('{"level": level}', '{"level": level[1:]}'),
    ('{"level": level}', '{"level": "abc"}'),
    ('{"level": level}', '{"level": level + 1j}'),
    ('{"level": level}', "{3: level}"),
    ('{"level": level}', "{}"),
    ("theta, t, {", "theta, t[::-1], {"),
    ("theta, t, {", "theta, t * np.nan, {"),
    ("theta, t, {", "theta[:1], t, {"),
    ("theta, t, {", "theta + 100, t, {"),
    ("def run(theta, seed=0)", "def run()"),
    ("def run(theta, seed=0)", "async def run(theta, seed=0)"),
    ('"valve": "%"', '"nosuch": "%"'),
    ('"valve": "%"', '"valve": 3'),
)


def own(dice: Dice) -> Wrong:
    """Return a wrong Python file."""
    old, new = dice.choice(_CHANGES)
    assert old in OWN
    text = OWN.replace(old, new, 1).encode()
    text = dice.choice([text] * 9 + [noise(dice), b"\xff" + text, b"x = '\x00'\n" + text])
    check = dice.random() < 0.8
    words = ("check", "own.py:scenario") if check else ("calibrate", "own.py:scenario", *_QUICK)
    found = typed(*words, files={"own.py": text}, told=True)
    return Wrong(found.call, f"{found.about} with {new!r}", (), found.files, told=True)


# --- Recorded runs, and tables to choose from.


def cells(dice: Dice) -> bytes:
    """Return a record that holds no run."""
    head, rows = b"time [s],level [m],valve [%]\n", [b"%d,%d.5,%d\n" % (k, k, 9 * k) for k in range(9)]
    return dice.choice(
        [
            b"",
            b"\n\n\n",
            head,
            b"".join(rows)[:3],
            head + b"a,b,c\n" * 4,
            head + b"".join(rows).replace(b",", b",x"),
            b"time [s],level [m],level [m]\n" + b"".join(rows),
            b"level\n1\n2\n",
            head + b"1,2\n" + b"1,2,3,4\n" * 3,
            noise(dice),
            b"PK\x03\x04" + noise(dice),
            b"PAR1" + noise(dice) + b"PAR1",
            head + b"nan,nan,nan\n" * 5,
            head + b"inf,1,1\n" * 3,
            head + b'0,"1\n' * 4,
        ]
    )


def _book(dice: Dice, kind: str) -> bytes:
    """Return an Excel or Parquet file that is damaged, or holds no numbers."""
    buffer = io.BytesIO()
    if kind == "xlsx":
        with zipfile.ZipFile(buffer, "w") as archive:
            archive.writestr(dice.choice(["a.txt", "xl/workbook.xml", "[Content_Types].xml"]), noise(dice))
        return dice.choice([buffer.getvalue(), noise(dice), buffer.getvalue()[:30]])
    table = pd.read_csv(io.BytesIO(RUNS["a.csv"]))
    nothing = dice.choice([table.iloc[:0], pd.DataFrame(), pd.DataFrame({"a": ["x", "y"], "b": ["z", "u"]})])
    whole = dice.random() < 0.5
    (nothing if whole else table).to_parquet(buffer)
    content = buffer.getvalue()
    return content if whole else content[: dice.randint(8, len(content) - 8)]


def records(dice: Dice) -> Wrong:
    """Return a wrong record of a run, or a wrong word about one, for `look`."""
    name, junk = word(dice), dice.choice(JUNK[2:])
    if dice.random() < 0.6:
        kind = dice.choice(["csv", "csv", "csv", "xlsx", "parquet"])
        content = cells(dice) if kind == "csv" else _book(dice, kind)
        words = ("look", "a.csv", f"{name}.{kind}", "--json")
        return typed(*words, named=(name,), files={**RUNS, f"{name}.{kind}": content})
    option, value, *more = dice.choice(
        [
            ("--time", name),
            ("--outputs", name),
            ("--outputs", "level,level", "'level'"),
            ("--inputs", name),
            ("--reference", f"{name}=1"),
            ("--reference", f"level={junk}", junk),
            ("--reference", "level"),
            ("--unit", f"level={name}"),
            ("--unit", f"{name}=m"),
            ("--unit", "level"),
            ("--columns", f"{name}={name}"),
            ("--columns", name),
            ("--port", junk),
            ("--out", f"{name}/{name}.png"),
            ("--out", f"x.{name}"),
            (f"--{name}", "3"),
        ]
    )
    json_too = () if option == "--out" else ("--json",)
    return typed(
        "look",
        "a.csv",
        "b.csv",
        option,
        value,
        *json_too,
        named=(option, value[:40], name, *more),
        files=RUNS,
    )


_CARS = b"name,price [EUR],range [km],length [m]\na,1,300,4\nb,2,500,4.5\nc,3,700,4.2\nd,4,650,4.9\n"


def _table_option(dice: Dice, name: str, junk: str) -> tuple[str, ...]:
    """Return a wrong option with its value, and what else may be named."""
    return dice.choice(
        [
            ("--lower", name),
            ("--higher", f"price,{name}"),
            ("--kpis", name),
            ("--lower=price", "--higher=price", "'price'"),
            ("--lower", "price,price", "'price'"),
            ("--lower", "name"),
            ("--lower", ","),
            ("--of", name),
            ("--start", name),
            ("--start", "99999"),
            ("--n-max", dice.choice(["0", "-1", junk])),
            ("--seed", dice.choice(["-1", junk])),
            ("--simulate", "3"),
            (f"--{name}", "3"),
            ("--calibrator", "ideal"),
        ]
    )


def tables(dice: Dice) -> Wrong:
    """Return a wrong table to choose from, or a wrong word about one."""
    name, junk = word(dice), dice.choice(JUNK[2:])
    if dice.random() < 0.5:
        head = b"name,price,range\n"
        kind = dice.choice(["csv", "csv", "xlsx", "parquet"])
        cells = [
            b"",
            head,
            head + b"a,1,2\n",
            head + b"a,x,y\nb,z,u\n",
            b"\n\n",
            noise(dice),
            b"PAR1" + noise(dice),
        ]
        cells += [
            head + b"a,1,2\na,1,2\n",
            b"price,price\n1,2\n3,4\n",
            head + b"a,nan,\nb,,nan\n",
            b"x\n1\n1\n1\n",
        ]
        content = dice.choice(cells) if kind == "csv" else _book(dice, kind)
        words = ("choose", f"{name}.{kind}", "--terminal", "--study", "./s.prefcal", "--out", "o")
        return typed(*words, named=(name,), files={f"{name}.{kind}": content})
    extra = _table_option(dice, name, junk)
    words = ("choose", "cars.csv", "--terminal", "--study", "./s.prefcal", "--out", "o", *extra[:2])
    return typed(*words, named=(*extra, name), files={"cars.csv": _CARS})


# --- Study files, and what a report holds.


class Made(NamedTuple):
    """A study that is right, and files of its report."""

    study: bytes
    exported: bytes
    best: bytes
    verification: bytes


_made: list[Made] = []


def made() -> Made:
    """Return them, made once."""
    if not _made:
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            for words in (
                ("calibrate", "lag", *_QUICK, "--study", "./s.prefcal", "--out", "o"),
                ("studies", "export", "./s.prefcal", "--out", "s.json"),
                ("verify", "o/best.json", "--runs", "3", "--jobs", "1"),
            ):
                said = command(words)(folder)
                assert said.code == 0, said
            places = ("s.prefcal", "s.json", "o/best.json", "o/verification.json")
            _made.append(Made(*((folder / place).read_bytes() for place in places)))
    return _made[0]


def studies(dice: Dice) -> Wrong:
    """Return a damaged or foreign study file, or a damaged export."""
    right, name = made(), word(dice)
    if dice.random() < 0.3:
        text = right.exported.rstrip()
        plain = json.loads(text)
        foreign = json.dumps(with_other(dice, plain, (dice.choice(sorted(plain)),))[0]).encode()
        content = dice.choice(
            [text[: dice.randrange(len(text))], noise(dice), b"[" * 99_999, foreign, b"{}", b"3"]
        )
        return typed("studies", "import", f"{name}.json", named=(name,), files={f"{name}.json": content})
    size = len(right.study)
    content = dice.choice(
        [
            right.study[: dice.randrange(1, size - 1)],
            noise(dice) + right.study[200:],
            right.study[:4096] + noise(dice, 9000).ljust(size - 4096, b"\x07"),
            noise(dice, 9000),
            b"SQLite format 3\x00" + noise(dice, 9000),
            right.exported,
            b" ",
        ]
    )
    path = f"./{name}.prefcal"
    words = dice.choice(
        [
            ("studies", "show", path),
            ("studies", "verify", path),
            ("studies", "export", path, "--out", "x.json"),
            ("report", path, "--out", "o"),
            ("calibrate", "lag", "--study", path, "--terminal", "--out", "o"),
            ("check", "lag", "--theta", f"{path}:1"),
            ("look", f"{path}:1", f"{path}:best", "--json"),
            ("calibrate", "lag", "--calibrator", "ideal", "--simulate", "9", "--n-max", "2", "--taste", path),
        ]
    )
    told = words[:2] == ("studies", "verify")  # its findings are what was asked for
    named = () if told else (name,)
    return typed(*words, named=named, files={f"{name}.prefcal": content}, told=told)


_NEEDED = ("format", "scenario", "theta", "settings")  # of best.json: the rest is for people


def results(dice: Dice) -> Wrong:
    """Return a damaged best.json, or a damaged verification.json, which is written anew."""
    right = made()
    if dice.random() < 0.3:
        content = damaged(dice, right.verification)
        if dice.random() < 0.5:
            plain = json.loads(right.verification)
            content = json.dumps(with_other(dice, plain, dice.choice(list(leaves(plain))))[0]).encode()
        files = {"best.json": right.best, "verification.json": content}
        return typed("verify", "best.json", "--runs", "1", "--jobs", "1", files=files, codes=(0, 1, 2))
    plain, how = json.loads(right.best), dice.randrange(5)
    if how == 4:  # what is for people may be anything
        path = dice.choice([path for path in leaves(plain) if path[0] not in _NEEDED])
        content = json.dumps(with_other(dice, plain, path)[0]).encode()
        words, files = ("verify", "best.json", "--runs", "1", "--jobs", "1"), {"best.json": content}
        return typed(*words, named=("best.json",), files=files, codes=(0, 1, 2))
    paths = [path for path in leaves(plain) if path[0] in _NEEDED]
    path = dice.choice([p for p in paths if p != ("settings",)])
    if how == 0:
        plain, _ = with_other(dice, plain, path)
    elif how == 1:
        del at(plain, path[:-1])[path[-1]]
    elif how == 2:
        plain["theta"][dice.choice(sorted(plain["theta"]))] = dice.choice(
            [1e300, -1e300, 10**400, float("nan")]
        )
    content = damaged(dice, right.best) if how == 3 else json.dumps(plain).encode()
    named = ("best.json",) if how == 3 else ("best.json", *map(str, path))
    return typed(
        "verify", "best.json", "--runs", "1", "--jobs", "1", named=named, files={"best.json": content}
    )


# --- Tunings to export, and step tests to identify.

BEST: Mapping[str, Any] = {
    "format": 1,
    "scenario": "heater.py:heater",
    "title": "Heater",
    "theta": {"K_p": 2.0, "T_i": 120.0},
    "units": {"K_p": "%/°C", "T_i": "s"},
    "channels": {"time_unit": "s", "x": [], "u": [["valve", "%"]], "y": [["T", "°C"]]},
}
"""A best.json of a PID, without its settings."""
_TUNED: Sequence[Controller] = (
    PID(2.0, 120.0, 10.0, T_s=1.0, b=0.5, low=0.0, high=100.0),
    LQR(Plant.of(([1.0], [9.0, 1.0])), [1.0], [1.0], T_s=0.5),
    LinearMPC(Plant.of(([1.0], [9.0, 1.0])), MPCSettings(0.5, 5, 2, [[1.0]], [[0.1]])),
)


def exports(dice: Dice) -> Wrong:
    """Return a wrong best.json for `export`, or a wrong word about one."""
    name, junk, how = word(dice), dice.choice(JUNK[2:]), dice.randrange(5)
    plain: Any = {**json.loads(json.dumps(BEST)), "settings": as_data(dice.choice(_TUNED))}
    if "model" in plain["settings"]:
        plain["channels"]["x"] = [["x1", ""]]
    words: tuple[str, ...] = ("--to", "c")
    named: tuple[str, ...] = ("best.json",)
    needed = [path for path in leaves(plain) if path[0] in ("settings", "channels", *_NEEDED)]
    content = b""
    if how == 0:  # a value of another type; None is an infinite one in settings
        # In place of None, a number is a right one: a limit where there was none.
        held = [path for path in needed if path[0] != "channels" and at(plain, path) is not None]
        path = dice.choice(held)
        plain, new = with_other(dice, plain, path)
        if new is None and path[0] == "settings":
            at(plain, path[:-1])[path[-1]] = "abc"
        named = ("best.json", str(path[-1]))
    elif how == 1:  # what must be there is not
        inner = [(k,) for k in _NEEDED] + [("settings", k) for k in plain["settings"] if k in _NO_DEFAULT]
        path = dice.choice(inner)
        del at(plain, path[:-1])[path[-1]]
        named = ("best.json", str(path[-1]))
    elif how == 2:  # too few channels, or none
        key = dice.choice(["u", "y", *(["x"] if "model" in plain["settings"] else [])])
        plain["channels"][key] = dice.choice(
            [[3], 3, [[]], "abc", [[name] * 9], None, [{"a": 1}], [] if key != "x" else 3]
        )
        named = ("channels",)
    elif how == 3:
        content = damaged(dice, json.dumps(plain).encode())
    else:
        words, named = _wrong_words(dice, name, junk)
    files = {"best.json": content or json.dumps(plain).encode()}
    return typed("export", "best.json", *words, named=named, files=files)


def _wrong_words(dice: Dice, name: str, junk: str) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return wrong words after a right best.json, and what must be named."""
    return dice.choice(
        [
            (("--to", name), ("--to", name)),
            ((), ("--to",)),
            (("--to", "c", "--name", f"1{junk}"), ("name",)),  # abc alone is a name
            (("--to", "forms", "--time", name), (name, "only a PID")),
            (("--to", "forms", "--ranges", junk), ("--ranges",)),
            (("--to", "c", "--ranges", "0:1,0:1"), ("ranges",)),
            (("--to", "forms", "--ranges", "5:1,0:9"), ("--ranges",)),
            (("--to", "c", "--out", f"{name}/a.h"), ("--out", name)),
            (("--to", "c", name), (name,)),
            (("--to", "c", f"--{name}"), (name,)),
        ]
    )


_NO_DEFAULT = ("K_p", "T_s", "model", "Q", "R", "integral", "Q_i", "controller")
_STEP = b"time [s],level [m],valve [%]\n" + b"".join(
    b"%d,%.4f,%d\n" % (k, 2 + (k > 10) * (1 - 0.8 ** (k - 10)), 40 + 10 * (k > 9)) for k in range(60)
)


def steps(dice: Dice) -> Wrong:
    """Return a wrong record of a step test, or a wrong word about one, for `identify`."""
    name, junk = word(dice), dice.choice(JUNK[2:])
    if dice.random() < 0.5:
        kind = dice.choice(["csv", "csv", "csv", "xlsx", "parquet"])
        content = cells(dice) if kind == "csv" else _book(dice, kind)
        content = dice.choice([content, content, RUNS["a.csv"], b"".join(_STEP.splitlines(True)[:9])])
        return typed("identify", f"{name}.{kind}", named=(), files={f"{name}.{kind}": content})
    words, named = dice.choice(
        [
            (("step.csv", "--input", name), (name,)),
            (("step.csv", "--output", name), (name,)),
            (("step.csv", "--input", "level", "--output", "level"), ("level",)),
            (("step.csv", "--time", name), (name,)),
            (("step.csv", "--unit", f"level={name}"), (name,)),
            (("step.csv", "--unit", f"{name}=m"), (name,)),
            (("step.csv", "--unit", "level"), ("--unit",)),
            (("step.csv", "--limits", junk), ("--limits",)),
            (("step.csv", "--limits", "9:1"), ("--limits",)),
            (("step.csv", "--resolution", dice.choice(["-1", "nan", junk])), ("--resolution", "resolution")),
            (("step.csv", "--out", f"{name}/{name}.png"), (name,)),
            (("step.csv", "--out", f"x.{name}"), (name,)),
            (("step.csv", name), (name,)),
            ((f"{name}.csv",), (name,)),
            (("step.csv", f"--{name}"), (name,)),
        ]
    )
    return typed("identify", *words, named=named, files={"step.csv": _STEP})


# --- All of them.

COMMANDS: Mapping[str, Callable[[Dice], Wrong]] = {
    "options": options,
    "files": files,
    "own": own,
    "records": records,
    "tables": tables,
    "studies": studies,
    "results": results,
    "exports": exports,
    "steps": steps,
}
"""What makes a wrong input for the commands, at each door."""
