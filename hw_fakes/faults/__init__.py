"""What can go wrong, on the wires and in the chip: by plan, by hand, with its history."""
