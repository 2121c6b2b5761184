"""Run `prefcal bench compare`."""

import shlex

from prefcal_app.cli.interrupt import INTERRUPTED
from prefcal_bench.published.plan import PUBLISHED, Plan, plan, read_published
from prefcal_bench.published.raw import raw_file, write_raw
from prefcal_bench.results import write
from prefcal_env.errors import SettingsError

from .options import CompareOptions
from .run import as_json, run_all, show


def compare(options: CompareOptions) -> int:
    """Run the missing cells of one agent, write the page, and return the exit code.

    Raises:
        PrefcalError: If the options are invalid, or a file or folder cannot be used.
    """
    planned = plan_of(options)
    suite = planned.suite
    finished = run_all(suite, options)
    if finished is None:
        return INTERRUPTED
    mine = suite.baseline
    page = write(
        finished.results, (), options.out, command=command_of(options), digest=finished.digest,
        notes=(*planned.notes, *suite.left_out), baseline=mine, published=planned.published,
    )  # fmt: skip
    write_raw(finished.results, raw_file(options.out))
    if options.json:
        print(as_json(finished, suite, page, planned.published))
    else:
        show(finished, page, mine, planned.published)
    return 1 if finished.failures else 0


def plan_of(options: CompareOptions) -> Plan:
    """Return what the options ask for.

    Raises:
        SettingsError: If nothing is published yet, or a name is unknown.
        ScenarioError: If the file of a user's own agent cannot be loaded.
    """
    if options.published is None and not PUBLISHED.is_file():
        raise SettingsError("no runs come with this prefcal: name a file of yours, --published")
    names = {
        name: None if (value := getattr(options, name)) is None else _words(value)
        for name in ("problems", "calibrators")
    }
    published = read_published(options.published)
    return plan(options.agent, published, names["problems"], names["calibrators"], options.seeds)


def _words(value: str) -> tuple[str, ...]:
    return tuple(word.strip() for word in value.split(","))


def command_of(options: CompareOptions) -> str:
    """Return the command line that repeats the comparison."""
    words = ["prefcal", "bench", "compare", options.agent]
    for name in ("published", "problems", "calibrators", "seeds"):
        if (value := getattr(options, name)) is not None:
            words += [f"--{name}", str(value)]
    return shlex.join([*words, "--out", str(options.out)])
