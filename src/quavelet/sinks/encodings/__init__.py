"""How a message is written, one small file each."""
