"""The knobs that θ is made of: ranges, scales, constraints, and changes of the space."""
