"""Counts to SI: the model, stillness, and the gyroscope's bias."""
