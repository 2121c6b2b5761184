"""In which order agents are named, everywhere."""

from collections.abc import Iterable

LEARNING = (
    "GLISp", "GLISp.paper", "GLIS", "PPO", "SAC",
    "ReferenceGLISp", "ReferenceGLIS", "OptunaPreferential",
)  # fmt: skip
BLIND = ("LatinHypercube", "RandomSearch")
"""Agents that come with the project: those that learn, ours before peers, and the others."""


def in_order(agents: Iterable[str]) -> tuple[str, ...]:
    """Learning agents that come with the project, then others by name, then blind searches."""

    def key(agent: str) -> tuple[int, int, str]:
        for group, names in ((0, LEARNING), (2, BLIND)):
            if agent in names:
                return (group, names.index(agent), agent)
        return (1, 0, agent)

    return tuple(sorted(set(agents), key=key))
