"""The ask/tell protocol that all agents share."""
