"""`python -m hw_fakes serve`, and its control line."""
