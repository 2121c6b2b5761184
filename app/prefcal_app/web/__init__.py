"""Serve the query window: a local web page on which a person compares experiments."""

from prefcal_app.web.server.browser import open_browser as open_browser
from prefcal_app.web.server.serve import Window as Window
