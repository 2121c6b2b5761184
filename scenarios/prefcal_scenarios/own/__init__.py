"""People's own files: loading them, checking them, and naming the line of an error."""
