"""What the next θ minimizes: exploration, expected improvement, and what marks add to them."""
