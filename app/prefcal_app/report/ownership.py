"""Reserve a folder for each study, so that a report never replaces another study's."""

import json
from dataclasses import asdict, dataclass
from itertools import count
from pathlib import Path

from prefcal_env.errors import SettingsError
from prefcal_scenarios.presentation.folder import folder_for

MARKER = "study.json"
"""Name of the file in a report's folder that identifies the study."""
_REPORT = ("report.html", "best.json", "comparisons.csv")


@dataclass(frozen=True, slots=True)
class Owner:
    """Study that a report belongs to.

    Args:
        identity: Text that is equal only for the same study.
        study: Name of the study; None if it is not kept in a file.
        scenario: Scenario of the study, as on the command line.
    """

    identity: str
    study: str | None
    scenario: str


@dataclass(frozen=True, slots=True)
class Ownership:
    """Folder that is reserved for a study.

    Args:
        folder: Folder of the report.
        owner: Study that owns it.
        marked: Whether this run wrote the marker file, rather than an earlier one.
        made: Whether this run created the folder.
    """

    folder: Path
    owner: Owner
    marked: bool
    made: bool

    def renew(self) -> None:
        """Write the marker again, in case another run of this study removed it."""
        _claim(self.folder, self.owner)

    def release(self) -> None:
        """Remove the marker and the folder if they are new, since there is no report."""
        if not self.marked or (self.folder / "report.html").exists():
            return
        try:
            (self.folder / MARKER).unlink(missing_ok=True)
            if self.made:
                self.folder.rmdir()
        except OSError:
            pass  # keep a folder to which other files were added


def claim_given(path: Path, owner: Owner) -> Ownership:
    """Claim the folder that the user named; it may exist.

    Raises:
        SettingsError: If it is not a folder, cannot be written to, or holds another report.
    """
    claim = _claim(path, owner)
    if claim is None:
        raise SettingsError(f"--out {path} holds {_holder(path)}: choose another folder, or remove that one")
    return claim


def claim_default(base: Path, owner: Owner) -> Ownership:
    """Claim the first of `base`, base-2, base-3, ... that is free or belongs to the study.

    Raises:
        SettingsError: If none can be created or written to.
    """
    for copy in count(1):
        path = base if copy == 1 else base.with_name(f"{base.name}-{copy}")
        if path.exists() and not path.is_dir():
            continue
        claim = _claim(path, owner)
        if claim is not None:
            return claim
    raise AssertionError("never reached: count does not end")


def _claim(path: Path, owner: Owner) -> Ownership | None:
    """Return the claim; None if the folder belongs to another study."""
    there = path.is_dir()
    folder = folder_for(path)
    marker = folder / MARKER
    if not marker.exists() and any((folder / name).exists() for name in _REPORT):
        return None
    try:
        # Exclusive creation: of two studies that try at the same time, one succeeds.
        with marker.open("x", encoding="utf-8") as file:
            json.dump(asdict(owner), file, indent=2, ensure_ascii=False)
            file.write("\n")
    except FileExistsError:
        mine = _read(marker).get("identity") == owner.identity
        return Ownership(folder, owner, marked=False, made=False) if mine else None
    except OSError as error:
        raise SettingsError(f"cannot write into the folder {path}: {error.strerror}") from error
    return Ownership(folder, owner, marked=True, made=not there)


def _holder(folder: Path) -> str:
    content = _read(folder / MARKER)
    if not content:
        return "a report whose study is not known"
    name = content.get("study")
    of = f"study {name!r}" if name else f"another study of {content.get('scenario')}"
    return f"the report of {of}"


def _read(marker: Path) -> dict[str, object]:
    """Return the content of a marker; empty if it cannot be read."""
    try:
        content = json.loads(marker.read_text("utf-8"))
    except (OSError, ValueError):
        return {}
    return content if isinstance(content, dict) else {}
