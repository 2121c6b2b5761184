"""Check what a release would publish: build it, install it elsewhere, and run every command there.

    python benchmarks/release/check.py [--out dist] [--extra notebook] [--newest]
    python benchmarks/release/check.py --into PYTHON [PYTHON ...]  # CI: in environments that exist

Builds the source distributions of prefcal and prefcal-bench and, from them, the wheels; checks all
with twine and compares the wheels' files with those of the repository. Then installs prefcal in a
new environment and an empty folder, without the repository, measures what starting costs, adds
prefcal-bench, and there runs each command with `--help` and once for real. `--newest` leaves the
pins of constraints.txt out. `--into` takes environments that have what prefcal needs, puts nothing
but the wheel there, and runs what somebody runs first: less than a minute.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
import venv
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import exp
from pathlib import Path

ROOT = Path(__file__).parents[2]
SOURCES = (ROOT, *(ROOT / each for each in ("agents", "scenarios", "app", "benchmarks")))
DISTRIBUTIONS: Mapping[str, tuple[Path, tuple[str, ...]]] = {
    "prefcal": (ROOT, ("prefcal_env", "prefcal_agents", "prefcal_scenarios", "prefcal_app")),
    "prefcal_bench": (ROOT / "benchmarks", ("prefcal_bench",)),
}
"""Folders of the distributions, and their packages."""
LIMITS = {("-c", "import prefcal_env"): 0.4, ("-m", "prefcal_app", "--help"): 0.4}
"""Processor seconds that starting may cost."""

COMMANDS = """
from importlib.metadata import entry_points
from typer.main import get_command
from prefcal_app.cli import app

def walk(command, words):
    print(" ".join(words))
    for name, inner in getattr(command, "commands", {}).items():
        walk(inner, [*words, name])

walk(get_command(app), [])
for found in entry_points(group="prefcal.commands"):
    walk(get_command(found.load()), [found.name])
"""
"""Prints the words of every command, one per line; the first line is that of `prefcal` itself."""

LEAST = """
import os, subprocess, sys

def used():
    now = os.times()
    return now.children_user + now.children_system

limit, *words = sys.argv[1:]
least = []
while len(least) < 40 and (len(least) < 7 or min(least) > float(limit)):
    before = used()
    subprocess.run([sys.executable, *words], check=True, stdout=subprocess.DEVNULL)
    least.append(used() - before)
print(min(least))
"""
"""Prints the least processor seconds of a Python command, in up to 40 trials if it has a limit."""

FILES: Mapping[str, str] = {
    "a.csv": "time,level [m],valve\n0,0,1\n1,1.2,0.4\n2,2,0\n3,2,0\n",
    "b.csv": "time,level [m],valve\n0,0,0.5\n1,0.5,0.5\n2,1,0.5\n3,1.5,0.5\n",
    "runs.csv": "overshoot,settling_time\n" + "".join(f"{n},{9 - n}\n" for n in range(8)),
    "step.csv": "time,valve [%],level [cm]\n"
    + "".join(
        f"{t},{40 if t < 5 else 46},{50 + 10 * (1 - exp(-max(t - 7, 0) / 12)):.3f}\n" for t in range(60)
    ),
    "tuned.py": "from prefcal_app import load_controller\nprint(load_controller('report/best.json').T_s)\n",
}
"""Files that the runs below read."""

RUNS: Mapping[str, Sequence[str]] = {
    "scenarios": ("scenarios", "scenarios cstr"),
    "new": tuple(f"new {kind}" for kind in ("function", "pid", "controller", "mpc", "fmu", "rig", "opcua")),
    "check": ("check controller.py:scenario",),
    "calibrate": (
        "calibrate cstr --agent glisp --calibrator synthetic --n-max 6 --n-init 3 "
        "--study s.prefcal --out report",
        "calibrate cstr --simulate 30 --calibrator synthetic --n-max 4 --out screened",
        "calibrate overtake --agent random --calibrator synthetic --n-max 2 --out overtaken",
        "calibrate servo --agent glisp --calibrator hidden --n-max 5 --study servo.prefcal",
        "calibrate pid --plant step.csv --calibrator synthetic --cost settling_time --simulate 30 "
        "--n-max 3 --out pid",
    ),
    "verify": ("verify pid/best.json --runs 5 --jobs 1",),
    "export": tuple(f"export pid/best.json --to {form}" for form in ("st", "c", "forms")),
    "identify": ("identify step.csv",),
    "choose": ("choose runs.csv --terminal",),  # nobody is there to answer: it says so and stops
    "look": (
        "look a.csv b.csv --reference level=2 --inputs valve --out pair.png",
        "look s.prefcal:1 s.prefcal:best --json",
    ),
    "report": ("report s.prefcal --out again",),
    "studies list": ("studies list",),
    "studies show": ("studies show s.prefcal",),
    "studies export": (
        "studies export s.prefcal",
        "studies export s.prefcal --format csv",
        "studies export s.prefcal --format parquet --out columns",
    ),
    "studies import": ("studies import s.json --study ./second.prefcal",),
    "studies verify": ("studies verify ./second.prefcal",),
    "studies respace": ("studies respace ./second.prefcal --knob T_s=0.2:0.6",),
    "studies rename": ("studies rename ./second.prefcal ./third.prefcal",),
    "studies rm": ("studies rm ./third.prefcal --yes",),
    "bench": (
        "bench --quick --problems servo,branin --calibrators weights,perfect --seeds 1 "
        "--n-max 8 --agents GLISp,RandomSearch --jobs 1",
    ),
    "bench compare": (
        "bench compare RandomSearch --problems servo --calibrators weights --seeds 1 --jobs 1",
    ),
    "reproduce": ("reproduce paper --seeds 1 --jobs 1",),
}
"""What is run of each command, in this order, since later runs read what earlier ones wrote."""
FIRST = ("calibrate cstr --calibrator synthetic --n-max 4 --simulate 30 --out first", *RUNS["new"])
"""What is run in environments that exist."""


GROUPS = {"bench", "studies"}  # words that come before a command, some of them commands of their own


class WrongError(Exception):
    """What is built is not fit for release."""


@dataclass(frozen=True, slots=True)
class Place:
    """An environment with the wheel, and an empty folder to run in."""

    folder: Path
    python: Path

    def run(self, *words: str) -> str:
        """Return what a Python command prints. Raises WrongError if it fails."""
        return self._output(self.python, *words)

    def prefcal(self, *words: str) -> str:
        """Return what the installed command `prefcal` prints. Raises WrongError if it fails."""
        name = "prefcal.exe" if os.name == "nt" else "prefcal"
        program = self.python.with_name(name)
        if not program.is_file():
            raise WrongError(f"the wheel installs no command {name}")
        return self._output(program, *words)

    def _output(self, program: Path, *words: str) -> str:
        done = subprocess.run(
            [program, *words],
            cwd=self.folder,
            env=self.environment,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            encoding="utf-8",
            check=False,
        )
        if done.returncode:
            told = f"{done.returncode}\n{done.stdout}{done.stderr}"
            raise WrongError(f"{program.name} {' '.join(words)}: {told}")
        return done.stdout

    @property
    def environment(self) -> dict[str, str]:
        """Return the environment variables of a user who has no repository."""
        ours = ("PYTHONPATH", "PYTHONDONTWRITEBYTECODE", "PREFCAL_DOCS", "VIRTUAL_ENV")
        kept = {k: v for k, v in os.environ.items() if k not in ours}
        data = {"XDG_DATA_HOME": str(self.folder / "data"), "PYTHONUTF8": "1", "MPLBACKEND": "Agg"}
        return kept | data


def build(out: Path, name: str) -> Path:
    """Build and check the source distribution and the wheel called `name` in `out`; return the wheel."""
    old = [*out.glob(f"{name}-*.whl"), *out.glob(f"{name}-*.tar.gz")]
    if old:
        raise WrongError(f"{out} holds {old[0].name} already: name an empty folder with --out")
    folder, packages = DISTRIBUTIONS[name]
    subprocess.run(
        [sys.executable, "-m", "build", "--outdir", out, folder], check=True, stdout=subprocess.DEVNULL
    )
    (wheel,), (source,) = out.glob(f"{name}-*.whl"), out.glob(f"{name}-*.tar.gz")
    subprocess.run([sys.executable, "-m", "twine", "check", "--strict", wheel, source], check=True)
    missing = expected(packages) ^ packed(wheel)
    if missing:
        raise WrongError(f"{wheel.name} and repository differ in {sorted(missing)}")
    return wheel


def expected(packages: Sequence[str]) -> set[str]:
    """Return the files of the packages as Git knows them, relative to where they are installed."""
    listed = subprocess.run(
        ["git", "ls-files", "-z"], cwd=ROOT, check=True, capture_output=True, text=True
    ).stdout.split("\0")
    homes = [each for each in SOURCES if each != ROOT]
    inner = [
        (ROOT / name).relative_to(home)
        for name in listed
        for home in (*homes, ROOT)
        if (ROOT / name).is_relative_to(home)
    ]
    return {path.as_posix() for path in inner if path.parts[:1] and path.parts[0] in packages}


def packed(wheel: Path) -> set[str]:
    """Return the files in a wheel, but for what describes it."""
    with zipfile.ZipFile(wheel) as archive:
        return {name for name in archive.namelist() if ".dist-info/" not in name}


def place_in(folder: Path) -> Place:
    """Return a new environment with an empty folder."""
    venv.create(folder / "venv", with_pip=True)
    scripts = "Scripts" if os.name == "nt" else "bin"
    empty = folder / "empty"
    empty.mkdir()
    return Place(empty, folder / "venv" / scripts / "python")


def place_of(python: Path, folder: Path, wheel: Path) -> Place:
    """Return an existing environment, with this wheel in place of its prefcal, and an empty folder."""
    place = Place(Path(tempfile.mkdtemp(dir=folder)), python)
    place.run("-m", "pip", "install", "-q", "--no-deps", "--force-reinstall", str(wheel))
    from_there(place)
    return place


def from_there(place: Place) -> None:
    """Raise WrongError if the environment imports prefcal from somewhere else."""
    where = place.run("-c", "import prefcal_env; print(prefcal_env.__file__)")
    if str(place.python.parents[1]) not in where:
        raise WrongError(f"the environment imports prefcal from {where}")


def install(place: Place, wheel: Path, extra: str, pinned: bool) -> None:
    """Install the wheel in an environment. Raises WrongError if prefcal is not imported from there."""
    pins = ("-c", str(ROOT / "constraints.txt")) if pinned else ()
    place.run("-m", "pip", "install", "-q", *pins, f"{wheel}[{extra}]" if extra else str(wheel))
    from_there(place)


def started(place: Place) -> None:
    """Start the installed command `prefcal` itself: all other runs start its module."""
    number = place.run("-c", "import importlib.metadata as m; print(m.version('prefcal'))").strip()
    if number not in place.prefcal("--version").split():
        raise WrongError(f"prefcal --version does not show {number}")
    if "Usage" not in place.prefcal("--help"):
        raise WrongError("prefcal --help shows no usage")


def smoke(place: Place) -> None:
    """Run each command with `--help` and for real."""
    started(place)
    for name, content in FILES.items():
        (place.folder / name).write_text(content, encoding="utf-8")
    commands = [line for line in dict.fromkeys(place.run("-c", COMMANDS).splitlines()) if line]
    untried = set(commands) - set(RUNS) - GROUPS
    if untried or not commands:
        raise WrongError(f"no run here tries {sorted(untried) or 'anything'}")
    for command in ("", *commands):
        if "Usage" not in place.run("-m", "prefcal_app", *command.split(), "--help"):
            raise WrongError(f"prefcal {command} --help shows no usage")
    for command, runs in RUNS.items():
        for words in runs:
            begun = time.monotonic()
            place.run("-m", "prefcal_app", *words.split())
            print(f"  {time.monotonic() - begun:5.1f} s  prefcal {words}", flush=True)
        assert command in commands, f"{command} is no command any more"
    place.run("tuned.py")


def begin(place: Place) -> None:
    """Run what somebody runs first, in an environment that had another prefcal before."""
    started(place)
    for words in FIRST:
        place.prefcal(*words.split())
    print("  fine:", "; ".join(("--help", *FIRST)))


def starts(place: Place) -> None:
    """Measure what starting costs. Other programs can only lengthen it: the least of 40 counts."""
    if os.name == "nt":
        print("  not measured: Windows does not tell the processor time of child processes")
        return
    for words, limit in LIMITS.items():
        used = float(place.run("-c", LEAST, str(limit), *words))
        print(f"  {used:.2f} s of processor time, at most {limit:g}: python {' '.join(words)}")
        if used > limit:
            raise WrongError(f"python {' '.join(words)} takes {used:.2f} s, more than {limit:g}")


def everything(folder: Path, wheel: Path, benchmark: Path, extra: str, pinned: bool) -> None:
    """Install the wheels in a new environment in `folder`, and run all that they bring."""
    print(f"{wheel.name}: installing it in a new environment", flush=True)
    place = place_in(folder)
    install(place, wheel, extra, pinned)
    starts(place)
    print(f"{benchmark.name}: installing it, too", flush=True)
    install(place, benchmark, "", pinned)
    smoke(place)


def main() -> None:
    """Check everything; exit with code 1 if anything is wrong."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, help="keep the distributions in this folder")
    parser.add_argument("--extra", default="", help="extras of prefcal to install, separated by commas")
    parser.add_argument("--newest", action="store_true", help="no pins from constraints.txt")
    parser.add_argument("--into", nargs="+", type=Path, metavar="PYTHON", help="of environments that exist")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        out = Path(name) / "dist" if given.out is None else given.out.resolve()
        out.mkdir(parents=True, exist_ok=True)
        try:
            wheel, benchmark = build(out, "prefcal"), build(out, "prefcal_bench")
            if given.into:
                for python in given.into:
                    print(f"{wheel.name}: into the environment of {python}", flush=True)
                    # Not resolved: the link is what says which environment it is.
                    begin(place_of(python.absolute(), Path(name), wheel))
            else:
                everything(Path(name), wheel, benchmark, given.extra, not given.newest)
        except (WrongError, subprocess.CalledProcessError) as error:
            sys.exit(f"not fit for release: {error}")
    print("fit for release")


if __name__ == "__main__":
    main()
