"""Serve the query window: a local web page on which a person compares experiments."""

from .serve import Window as Window
from .serve import open_browser as open_browser
