"""Charts, and the page they stand on: for the report of a calibration, of a recording, of a paper."""
