"""What a PID scenario decides by itself: operating point, step, ranges, times and KPIs."""
