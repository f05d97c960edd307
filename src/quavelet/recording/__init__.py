"""The recording: what each drain read from the chip, byte for byte, written and replayed."""
