"""Taking noise out of a signal: wavelets, thresholds, medians, least squares."""
