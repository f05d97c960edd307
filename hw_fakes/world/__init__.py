"""What the board does and what is wrong with its sensors."""
