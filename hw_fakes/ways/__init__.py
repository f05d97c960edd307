"""The ways in for programs that know nothing of the fake."""
