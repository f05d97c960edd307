"""Where bytes go, one small file each."""
