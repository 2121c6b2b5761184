"""Read the trials of an Optuna study from its storage."""

from pathlib import Path
from typing import Any

from prefcal_env.errors import RecordError, SettingsError
from prefcal_env.optional import world
from prefcal_env.wording import did_you_mean

_WAYS = {"MINIMIZE": "lower", "MAXIMIZE": "higher"}


def trials(url: str, name: str | None, until: int | None) -> tuple[Any, dict[str, str]]:
    """Return what `trials_dataframe()` does of the finished trials, and directions by heading.

    Args:
        url: URL of the storage, such as sqlite:///study.db.
        name: Name of the study; None if the storage holds only one.
        until: Number of the last trial; None for all.

    Raises:
        MissingExtraError: If Optuna is not installed.
        RecordError: If the storage cannot be read, or no trial has finished.
        SettingsError: If it holds no such study, or several if none is named.
    """
    optuna = world("optuna").imported()
    file = url.partition(":///")[2].partition("?")[0]
    if url.startswith("sqlite") and not Path(file).is_file():  # Optuna would make an empty one
        raise RecordError(f"cannot read the Optuna study {url!r}: there is no file {file!r}")
    try:
        there = optuna.get_all_study_names(url)
    except Exception as error:  # of the storage, its driver and its data base
        said = " ".join(str(error).split())[:200]
        raise RecordError(f"cannot read the Optuna study {url!r}: {said}") from error
    chosen = there[0] if name is None and len(there) == 1 else name
    if chosen not in there:
        raise SettingsError(
            f"{url} holds the studies {', '.join(there) or 'none'}: name one with --of, got "
            f"{'none' if chosen is None else repr(chosen)}.{did_you_mean(chosen or '', there)}".rstrip(".")
        )
    study = optuna.load_study(study_name=chosen, storage=url)
    frame = study.trials_dataframe()
    finished = [] if frame.empty else frame["state"].isin(("COMPLETE", "PRUNED", "FAIL"))
    if not any(finished):
        raise RecordError(f"no trial of the Optuna study {chosen!r} has finished")
    last = frame["number"].max() if until is None else until
    names = study.metric_names or range(len(study.directions))
    values = ["value"] if "value" in frame else [f"values_{name}" for name in names]
    ways = [_WAYS.get(direction.name, "") for direction in study.directions]
    kept = frame[finished & (frame["number"] <= last)].reset_index(drop=True)
    return kept, dict(zip(values, ways, strict=True))
