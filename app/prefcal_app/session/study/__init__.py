"""What a study is at one moment: its agent and record, the open question, and what is to do."""
