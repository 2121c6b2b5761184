"""What Screening is judged by: which studies run, and what they are worth."""
