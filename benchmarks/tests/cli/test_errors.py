"""Wrong calls of `prefcal bench`: one line that helps, exit code 2, and nothing is left."""

import shlex

import pytest

from prefcal_app.cli.parameters import parameters_of
from prefcal_bench.cli.options import BenchOptions

CALLS = [
    ("bench --problems cst", "Did you mean 'cstr'?"),
    ("bench --agents GLIPs", "Did you mean 'GLISp'?"),
    ("bench --seeds 0", "--seeds"),
    ("bench --jobs 0", "jobs"),
    ("bench --agents GLIS --problems cstr-guidelines", "nothing to run: GLIS"),
    ("bench --n-init 9 --n-max 5", "--n-max must be at least --n-init"),
]


@pytest.mark.parametrize(("line", "said"), CALLS)
def test_a_wrong_call_is_one_line_that_helps_and_leaves_nothing(prefcal, tmp_path, line, said):
    code, out, err = prefcal(*shlex.split(line))
    assert (code, out) == (2, "")
    assert err.startswith("prefcal: ")
    assert err.count("\n") == 1
    assert said in err
    assert list(tmp_path.iterdir()) == []


def test_every_option_has_its_help():
    assert all(parameter.info.help for parameter in parameters_of(BenchOptions).values())


def test_help_teaches_with_an_example(done, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    out = done("bench", "--help")
    assert "prefcal bench" in out.partition("Examples")[2]
    assert "…" not in out  # no option or default is cut off
    assert "[/" not in out  # no markup that nobody has closed
    assert max(out) < "\U0001f000"  # the ":50:" of a range is no emoji


def test_no_help_has_words_that_stumble(done):
    out = " ".join(done("bench", "--help").replace("│", " ").split())
    for word in (" dear", " his ", " her ", " hers", "taken up", "begun", "whoever", "foretold"):
        assert word not in out.lower()
