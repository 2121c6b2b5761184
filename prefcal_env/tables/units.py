"""Read the units of columns from their headings, and compare units."""

SECONDS = {
    **dict.fromkeys(("ns",), 1e-9),
    **dict.fromkeys(("us", "µs", "μs"), 1e-6),
    **dict.fromkeys(("ms", "msec"), 1e-3),
    **dict.fromkeys(("s", "sec", "seconds"), 1.0),
    **dict.fromkeys(("min", "minutes"), 60.0),
    **dict.fromkeys(("h", "hours"), 3600.0),
    **dict.fromkeys(("d", "days"), 86400.0),
}
"""Length of each known unit of time in seconds."""


def parts_of(heading: str) -> tuple[str, str | None]:
    """Return name and unit of a heading "name [unit]"; the unit is None if there is none.

    Parentheses may hold a unit of time, as in "time (s)"; otherwise they belong to the name.
    """
    plain = heading.strip()
    if plain.endswith("]") and "[" in plain:
        name, _, unit = plain[:-1].rpartition("[")
        return name.strip(), unit.strip()
    if plain.endswith(")") and "(" in plain:
        name, _, unit = plain[:-1].rpartition("(")
        if unit.strip() in SECONDS:
            return name.strip(), unit.strip()
    return plain, None


def same_unit(one: str, other: str) -> bool:
    """Return whether two units are equal up to spaces, micro signs and superscripts."""
    return _plain(one) == _plain(other)


def _plain(unit: str) -> str:
    spelled = unit.replace(" ", "").replace("\u00b5", "\u03bc").replace("^", "")
    return spelled.translate(str.maketrans("\u00b2\u00b3", "23"))
