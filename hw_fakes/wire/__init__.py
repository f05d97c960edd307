"""The wires: chips at their addresses, messages, time."""
