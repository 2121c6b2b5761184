"""Word and style things in the same way on the page, in the report and in the terminal."""
