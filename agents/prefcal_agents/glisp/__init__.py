"""GLISp: settings, training, the strategy of its proposals, and follow-up questions."""
