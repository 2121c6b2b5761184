"""Format worth, intervals and probabilities as text."""


def short_name(agent: str) -> str:
    """Return the name of an agent without the folder of a user's own file."""
    return agent.rpartition("/")[2] or agent


def plain_number(value: float | None) -> str:
    """Return a worth with two significant digits, or all its digits from 10 on."""
    if value is None:
        return "–"
    return f"{value:.0f}" if value >= 9.95 else f"{value:.1f}"


def with_interval(value: float | None, low: float | None, high: float | None) -> str:
    """Return a worth with its interval."""
    if value is None or low is None:
        return plain_number(value)
    return f"{plain_number(value)} [{plain_number(low)}, {plain_number(high)}]"


def chance(value: float | None, low: float | None, high: float | None) -> str:
    """Return a probability in percent, with its interval."""
    if value is None:
        return "–"
    text = f"{100 * value:.0f} %"
    return text if low is None or high is None else f"{text} [{100 * low:.0f}, {100 * high:.0f}]"
