"""What an interview holds in memory alone: runs in progress, and what is thought of in advance."""
