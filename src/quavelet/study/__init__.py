"""The five papers and any recording, worked through offline: tables, plots, verdicts."""
