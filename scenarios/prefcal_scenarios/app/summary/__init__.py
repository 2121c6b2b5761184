"""What a study says as a whole: counts, consistency, outlook, and which KPIs matter."""
