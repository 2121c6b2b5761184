"""How things are worded and styled, the same on the page, in the report and in the terminal."""
