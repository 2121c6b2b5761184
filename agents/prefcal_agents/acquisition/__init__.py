"""Acquisitions, which the next θ minimizes: exploration, expected improvement, penalties."""
