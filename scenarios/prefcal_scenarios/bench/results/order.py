"""In which order agents are named, everywhere."""

from collections.abc import Iterable

LEARNING = ("GLISp", "GLISp.paper", "GLIS", "PPO", "SAC")
BLIND = ("LatinHypercube", "RandomSearch")
"""The project's own agents: those that learn, and those that do not."""


def in_order(agents: Iterable[str]) -> tuple[str, ...]:
    """The project's own learning agents first, then others by name, then the blind searches."""

    def key(agent: str) -> tuple[int, int, str]:
        for group, names in ((0, LEARNING), (2, BLIND)):
            if agent in names:
                return (group, names.index(agent), agent)
        return (1, 0, agent)

    return tuple(sorted(set(agents), key=key))
