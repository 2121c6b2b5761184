"""Worker processes: their start and end, and messages between them and prefcal."""
