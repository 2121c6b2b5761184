"""The knobs that θ is made of: ranges, scales, constraints, and changes of the space."""

from .knob import Knob as Knob
from .space import KnobSpace as KnobSpace
