"""One folder per study: a report never replaces another study's."""

import json
from dataclasses import asdict, dataclass
from itertools import count
from pathlib import Path

from prefcal_env.errors import SettingsError
from prefcal_scenarios.app.presentation.folder import folder_for

MARKER = "study.json"
"""The file in a report's folder that names the study."""
_REPORT = ("report.html", "best.json", "comparisons.csv")


@dataclass(frozen=True, slots=True)
class Owner:
    """The study that a report is of.

    Args:
        identity: Equal for the same study only.
        study: Name of the study; None if it is not kept in a file.
        scenario: What it calibrates, as on the command line.
    """

    identity: str
    study: str | None
    scenario: str


@dataclass(frozen=True, slots=True)
class Claim:
    """The folder that belongs to a study from now on.

    Args:
        folder: Of the report.
        owner: The study.
        marked: Whether this run has marked it; otherwise an earlier one had.
        made: Whether this run has made it.
    """

    folder: Path
    owner: Owner
    marked: bool
    made: bool

    def renew(self) -> None:
        """Mark the folder again, in case another run of this study has given it up."""
        _claim(self.folder, self.owner)

    def release(self) -> None:
        """Leave no trace of a folder that got no report."""
        if not self.marked or (self.folder / "report.html").exists():
            return
        try:
            (self.folder / MARKER).unlink(missing_ok=True)
            if self.made:
                self.folder.rmdir()
        except OSError:
            pass  # somebody has put files there: they stay


def claim_given(path: Path, owner: Owner) -> Claim:
    """Claim the folder that the user named; it may exist.

    Raises:
        SettingsError: it is no folder, cannot be written to, or holds another report.
    """
    claim = _claim(path, owner)
    if claim is None:
        raise SettingsError(
            f"--out {path} holds {_holder(path)}: take another folder, or remove that one"
        )
    return claim


def claim_default(base: Path, owner: Owner) -> Claim:
    """Claim `base`, or else base-2, base-3 ...: the first one that is free or the study's own.

    Raises:
        SettingsError: none can be made or written to.
    """
    for number in count(1):
        path = base if number == 1 else base.with_name(f"{base.name}-{number}")
        if path.exists() and not path.is_dir():
            continue
        claim = _claim(path, owner)
        if claim is not None:
            return claim
    raise AssertionError("never reached: count does not end")


def _claim(path: Path, owner: Owner) -> Claim | None:
    """The claim; None if the folder is another's."""
    there = path.is_dir()
    folder = folder_for(path)
    marker = folder / MARKER
    if not marker.exists() and any((folder / name).exists() for name in _REPORT):
        return None
    try:
        # Created or refused by the system: of two studies that come at once, one gets it.
        with marker.open("x", encoding="utf-8") as file:
            json.dump(asdict(owner), file, indent=2, ensure_ascii=False)
            file.write("\n")
    except FileExistsError:
        mine = _read(marker).get("identity") == owner.identity
        return Claim(folder, owner, marked=False, made=False) if mine else None
    except OSError as error:
        raise SettingsError(f"cannot write into the folder {path}: {error.strerror}") from error
    return Claim(folder, owner, marked=True, made=not there)


def _holder(folder: Path) -> str:
    content = _read(folder / MARKER)
    if not content:
        return "a report whose study is not known"
    name = content.get("study")
    of = f"study {name!r}" if name else f"another study of {content.get('scenario')}"
    return f"the report of {of}"


def _read(marker: Path) -> dict[str, object]:
    """What a marker says; nothing if it cannot be read."""
    try:
        content = json.loads(marker.read_text("utf-8"))
    except (OSError, ValueError):
        return {}
    return content if isinstance(content, dict) else {}
