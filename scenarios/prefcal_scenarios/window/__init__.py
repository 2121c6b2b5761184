"""The query window: a local web page on which a person compares experiments."""

from .browser import open_browser as open_browser
from .serve import Window as Window
