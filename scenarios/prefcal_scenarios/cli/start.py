"""θ as a person writes it on the command line."""

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import SettingsError
from prefcal_env.knobs import KnobSpace
from prefcal_scenarios.nearest import did_you_mean
from prefcal_scenarios.scenario import Scenario


def start_of(text: str, scenario: Scenario) -> Float[np.ndarray, " n"]:
    """The physical θ that `text` means, shape (n,).

    Either `knob=value, ...` for every knob, in any order, or the name of a reference of the
    scenario.

    Raises:
        SettingsError: no such reference, an unknown or missing knob, or no number.
        KnobError: a value outside its knob's range.
    """
    if "=" in text:
        return scenario.space.check(theta_of(text, scenario.space))
    if text not in scenario.references:
        known = sorted(scenario.references)
        raise SettingsError(
            f"--start must be KNOB=VALUE, ... or one of the references {known} of scenario "
            f"{scenario.name!r}, got {text!r}.{did_you_mean(text, known)}".rstrip(".")
        )
    return np.array(scenario.references[text], dtype=float)


def theta_of(text: str, space: KnobSpace) -> Float[np.ndarray, " n"]:
    """θ of `knob=value, ...`, shape (n,), physical; ranges are not looked at.

    Raises:
        SettingsError: an unknown or missing knob, one given twice, or no number.
    """
    given: dict[str, float] = {}
    for part in text.split(","):
        word, sign, value = (piece.strip() for piece in part.rpartition("="))
        if not sign:
            raise SettingsError(f"expected KNOB=VALUE, got {part.strip()!r} in {text!r}")
        name = knob_called(word, space)
        if name in given:
            raise SettingsError(f"knob {name!r} is given twice in {text!r}")
        try:
            given[name] = float(value)
        except ValueError as error:
            raise SettingsError(f"knob {name!r} must be a number, got {value!r}") from error
    missing = [name for name in space.names if name not in given]
    if missing:
        raise SettingsError(f"every knob needs a value, {missing} are missing in {text!r}")
    return np.array([given[name] for name in space.names])


def knob_called(word: str, space: KnobSpace) -> str:
    """Return the name of the knob that `word` means: its name, or how it alone begins.

    Underscores stand for spaces.

    Raises:
        SettingsError: none, or several.
    """
    plain = {name.replace(" ", "_"): name for name in space.names}
    wanted = word.replace(" ", "_")
    if wanted in plain:
        return plain[wanted]
    found = [name for key, name in plain.items() if wanted and key.startswith(wanted)]
    if len(found) != 1:
        hint = did_you_mean(word, plain)
        names = ", ".join(plain)
        raise SettingsError(f"knob must be one of {names}, got {word!r}.{hint}".rstrip("."))
    return found[0]
