"""What Screening is judged by: which studies run, what they are worth, and the bars."""
