from dataclasses import replace
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from platformdirs import user_cache_path

from prefcal_bench.people import USUAL, fingerprint, is_cached, sample
from prefcal_bench.people.sample import _CHECKED, size, thetas
from prefcal_env.errors import KnobError
from prefcal_env.knobs import Constraint, Knob, KnobSpace
from prefcal_scenarios.catalog import load
from prefcal_scenarios.scenario import KPI
from support.short_runs import short_run

SAMPLE = import_module("prefcal_bench.people.sample")  # the function has the same name
SPACE = KnobSpace([Knob("a", 0.0, 1.0), Knob("n", 1, 9, integer=True)])
TINY = load(str(Path(__file__).parents[1] / "bench_support" / "loop.py") + ":SCENARIO")
pytestmark = pytest.mark.usefixtures("small_samples", "own_cache")


@pytest.fixture
def own_cache(monkeypatch, tmp_path):
    """An empty cache folder."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setenv("WIN_PD_OVERRIDE_LOCAL_APPDATA", str(tmp_path / "cache"))
    return tmp_path / "cache"


class Counted:
    """A scenario's run that counts."""

    def __init__(self, run=TINY.run):
        self.run, self.count = run, 0

    def __call__(self, theta, seed=0):
        self.count += 1
        return self.run(theta, seed)


def counted(scenario=TINY):
    run = Counted(scenario.run)
    return replace(scenario, run=run), run


def files(folder):
    return sorted(path for path in folder.rglob("*") if path.is_file())


def same(a, b):
    return a.names == b.names and all(
        np.array_equal(getattr(a, part), getattr(b, part)) for part in ("values", "survived", "z")
    )


def test_no_test_reads_or_writes_the_user_s_cache(own_cache):
    assert user_cache_path("prefcal", appauthor=False).is_relative_to(own_cache)


def test_a_sample_is_computed_once_and_then_read(own_cache):
    scenario, run = counted()
    assert not is_cached(scenario, USUAL)
    before, run.count = run.count, 0
    first = sample(scenario, USUAL)
    assert before == _CHECKED
    assert run.count == 64 + _CHECKED
    assert is_cached(scenario, USUAL)
    run.count = 0
    assert same(sample(scenario, USUAL), first)
    assert run.count == _CHECKED  # to notice that the scenario has changed
    assert len(files(own_cache)) == 1


def test_what_is_sampled_is_what_the_scenario_gives():
    found = sample(TINY, USUAL)
    assert found.names == ("error", "effort", "margin")  # the score has no direction
    for z, row, survived in list(zip(found.z, found.values, found.survived, strict=True))[:9]:
        run = TINY.run(TINY.space.decode(z))
        assert row == pytest.approx([run.kpis["error"], run.kpis["effort"], -run.kpis["margin"]])
        assert survived == (run.duration if run.end.interrupted else np.inf)
    assert np.isfinite(found.survived).any()


def test_another_name_has_other_theta_and_all_are_spread_over_the_box():
    usual, pool = (np.array(thetas(TINY, name, 300)) for name in (USUAL, "pool"))
    assert np.mean((usual[:, None] == pool).all(axis=2)) < 1e-4  # knobs have steps of 0.01
    assert np.array_equal(np.array(thetas(TINY, USUAL, 10)), usual[:10])
    assert usual.mean(axis=0) == pytest.approx([0.5] * 3, abs=0.06)
    assert len(sample(TINY, "pool")) == 128


def test_a_changed_scenario_has_another_fingerprint():
    def other(theta, seed=0):
        run = TINY.run(theta, seed)
        return replace(run, kpis={**run.kpis, "effort": 1.01 * run.kpis["effort"]})

    def nearly(theta, seed=0):
        run = TINY.run(theta, seed)
        return replace(run, kpis={**run.kpis, "effort": (1 + 1e-12) * run.kpis["effort"]})

    a, b, c = TINY.space.knobs
    changed = [
        replace(TINY, run=other),
        replace(TINY, kpis=TINY.kpis[1:]),
        replace(TINY, kpis=(replace(TINY.kpis[0], better="higher"), *TINY.kpis[1:])),
        replace(TINY, space=KnobSpace([a, b, Knob("filter", 0.0, 0.9)])),
        replace(TINY, space=KnobSpace([a, b, c], [Constraint("no", lambda v: v["lead"] - 0.97)])),
    ]
    prints = {fingerprint(one) for one in (TINY, *changed)}
    assert len(prints) == 6
    sample(TINY, USUAL)
    assert not any(is_cached(one, USUAL) for one in changed)
    same_on_another_machine = replace(TINY, run=nearly, title="Another title")
    assert fingerprint(same_on_another_machine) == fingerprint(TINY)


def test_constraints_and_integers_are_respected():
    allowed = Constraint("sum", lambda v: v["a"] + v["n"] / 10 - 0.8)
    space = KnobSpace(SPACE.knobs, [allowed])
    scenario = replace(
        TINY,
        space=space,
        kpis=(KPI("a", "a", better="lower"),),
        run=lambda theta, seed=0: short_run(theta, kpis={"a": theta[0]}),
    )
    found = sample(scenario, USUAL)
    assert len(found) == 64
    for z in found.z:
        theta = space.decode(z)
        assert space.allows(theta)
        assert theta[1] == int(theta[1])
    assert {1, 2, 3} <= {int(space.decode(z)[1]) for z in found.z} <= set(range(1, 8))


def test_constraints_that_allow_nothing_are_refused(monkeypatch):
    monkeypatch.setattr(SAMPLE, "_FRUITLESS", 3)
    never = KnobSpace(SPACE.knobs, [Constraint("never", lambda v: 1.0)])
    with pytest.raises(KnobError, match="none of 768 random θ satisfies the constraints"):
        thetas(replace(TINY, space=never), USUAL, 4)


@pytest.mark.parametrize(
    "damage",
    [
        lambda raw: raw[: len(raw) // 2],
        lambda raw: b"",
        lambda raw: b"no archive",
        lambda raw: raw[:200] + bytes([raw[200] ^ 255]) + raw[201:],
        lambda raw: raw.replace(b"values.npy", b"walues.npy"),
        lambda raw: raw.replace(b"PK\x01\x02\x14", b"PK\x01\x02\xff"),
        lambda raw: raw[:6] + b"\x01" + raw[7:],
    ],
)
def test_a_damaged_file_is_computed_again(own_cache, damage):
    first = sample(TINY, USUAL)
    (path,) = files(own_cache)
    path.write_bytes(damage(path.read_bytes()))
    scenario, run = counted()
    assert same(sample(scenario, USUAL), first)
    assert run.count in (_CHECKED, 64 + _CHECKED)  # a flag that numpy ignores does no damage
    assert same(sample(TINY, USUAL), first)
    assert files(own_cache) == [path]


@pytest.mark.filterwarnings("error")
def test_a_file_with_flipped_bytes_is_never_taken_for_other_numbers(own_cache):
    first = sample(TINY, USUAL)
    (path,) = files(own_cache)
    raw, rng = path.read_bytes(), np.random.default_rng(0)
    for place in rng.integers(len(raw), size=40):
        path.write_bytes(raw[:place] + bytes([raw[place] ^ int(rng.integers(1, 256))]) + raw[place + 1 :])
        assert same(sample(TINY, USUAL), first)


def test_a_file_with_fewer_experiments_is_computed_again(own_cache, monkeypatch):
    sample(TINY, USUAL)
    (path,) = files(own_cache)
    with np.load(path) as content:
        np.savez(path, **{name: content[name][:9] for name in content})
    assert not is_cached(TINY, USUAL)
    assert len(sample(TINY, USUAL)) == 64


def test_a_cache_that_cannot_be_written_is_no_error(own_cache, monkeypatch):
    own_cache.write_text("a file, not a folder")
    first = sample(TINY, USUAL)
    assert len(first) == 64
    assert not is_cached(TINY, USUAL)
    own_cache.unlink()

    def full(*args, **columns):
        args[0].write(b"half")
        raise OSError("no space left on device")

    monkeypatch.setattr("numpy.savez", full)
    assert same(sample(TINY, USUAL), first)
    assert files(own_cache) == []  # no half of it is left


def test_quick_closed_loops_have_a_larger_pool(monkeypatch):
    monkeypatch.setattr(SAMPLE, "_QUICK_POOL", 9)
    assert [size(load(name), "pool") for name in ("servo", "mpc-oscillatory", "cstr")] == [9, 128, 128]
    assert size(replace(TINY, name="loop-3"), "pool") == 9
    assert size(load("servo"), USUAL) == size(TINY, USUAL) == 64
