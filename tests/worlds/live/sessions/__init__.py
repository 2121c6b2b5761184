"""Run random sessions on live plants, simulated and real ones, and check what must hold."""
