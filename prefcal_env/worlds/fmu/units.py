"""Units in which an FMU says that its variables can be shown, and how values are converted."""

import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

_NO_UNIT = ("", "-", "1")


@dataclass(frozen=True, slots=True)
class UnitScale:
    """Conversion of a value from an FMU's unit: factor · value + offset.

    Args:
        factor: Value of one unit of the FMU in the other unit, not 0.
        offset: What 0 in the FMU's unit is in the other unit.
    """

    factor: float = 1.0
    offset: float = 0.0

    def shown(self, value: Any) -> Any:
        """Return a value of the FMU, or an array of them, in the other unit."""
        return self.factor * value + self.offset

    def stored(self, value: Any) -> Any:
        """Return a value in the other unit, or an array of them, in the FMU's unit."""
        return (value - self.offset) / self.factor


AS_IT_IS = UnitScale()
"""Conversion into the same unit."""
Scales = Mapping[str, UnitScale]
"""Units by name, each with its conversion from the FMU's unit."""


def plain(unit: str) -> str:
    """Return a unit as FMUs spell it: "degC" for "°C", and nothing for "-" and "1"."""
    return "" if unit in _NO_UNIT else unit.replace("°", "deg")


def display_units(path: Path) -> Mapping[str, Scales]:
    """Return the display units that an FMU defines for each of its units.

    FMPy does not tell which display units of FMI 3 are inverse. These are left out.

    Args:
        path: The .fmu file, which FMPy could read.
    """
    with zipfile.ZipFile(path) as content:
        root = ElementTree.fromstring(content.read("modelDescription.xml"))
    return {
        unit.get("name", ""): {
            d.get("name", ""): UnitScale(float(d.get("factor", 1)), float(d.get("offset", 0)))
            for d in unit.iterfind("DisplayUnit")
            if d.get("inverse", "false") not in ("true", "1") and float(d.get("factor", 1))
        }
        for unit in root.iterfind("UnitDefinitions/Unit")
    }
