"""GLISp: its settings, its training, the strategy of its proposals and its follow-up questions."""
