"""The search that minimizes an acquisition over the unit cube."""
