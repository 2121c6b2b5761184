"""Run the application: sessions, report, query window, terminal and command line."""
