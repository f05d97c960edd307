"""The part of pymavlink that quavelet/sinks/encodings/mavlink.py uses; the package has no type hints of its own."""
