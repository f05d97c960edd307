"""Moving bytes: what a bus is, the Linux one, and opening one by name."""
