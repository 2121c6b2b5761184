"""Read the numbers in cells, and say what to do about cells that hold none."""

import re

_NUMBER = re.compile(r"[+-]?(\d+([.,]\d*)?|[.,]\d+)([eE][+-]?\d+)?", re.ASCII)
_DECIMAL_COMMA = re.compile(r"[+-]?\d+,\d+([eE][+-]?\d+)?")
_THOUSANDS = re.compile(r"[+-]?\d{1,3}([., ']\d{3})+([.,]\d+)?")
_WITH_UNIT = re.compile(r"[+-]?[\d.,]+([eE][+-]?\d+)? *[^\d\s.,:]{1,8}")
_SURELY_WITH_UNIT = re.compile(
    r"[+-]?(\d*[.,]\d+([eE][+-]?\d+)?|\d+([eE][+-]?\d+)?(?=[ %°])) *[^\d\s.,:]{1,8}"
)
"""Unlike `_WITH_UNIT`, no identifier such as 12A."""
_STAMP = re.compile(r"\d{1,4}[-/.]\d{1,2}[-/.]\d{1,4}\b.*|\d{1,2}:\d\d(:\d\d.*)?")


def number_of(cell: str, *, decimal_comma: bool) -> float | None:
    """Return the number in a cell; None for NaN, thousands separators, or no number."""
    plain = cell.strip()
    if not _NUMBER.fullmatch(plain) or ("," in plain and not decimal_comma):
        return None
    return float(plain.replace(",", "."))


def advice(cell: str) -> str:
    """Return what to do about a cell that is no number; "" if it looks like none at all."""
    plain = cell.strip()
    if _THOUSANDS.fullmatch(plain) and not _DECIMAL_COMMA.fullmatch(plain):
        return "remove the separators of thousands"
    if _DECIMAL_COMMA.fullmatch(plain):
        return (
            "use decimal points in all columns, or decimal commas in all of them with semicolons "
            "between the cells"
        )
    if _STAMP.fullmatch(plain):
        return "convert time stamps to numbers"
    if _WITH_UNIT.fullmatch(plain):
        return "put the unit into the heading, as in 'level [m]'"
    return ""


def almost_a_number(cell: str) -> bool:
    """Return whether a cell is a number but for its separators or its unit."""
    plain = cell.strip()
    patterns = (_NUMBER, _DECIMAL_COMMA, _THOUSANDS, _SURELY_WITH_UNIT)
    return any(pattern.fullmatch(plain) for pattern in patterns)
