"""The fixed-step loop, the real-time settings, and the hub that never blocks it."""
