"""Outputs: encodings and transports, one small file each."""
