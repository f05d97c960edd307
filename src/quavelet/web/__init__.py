"""The live page: one board, turning as it turns, in any browser."""
