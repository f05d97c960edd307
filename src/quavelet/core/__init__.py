"""Words everyone uses: blocks, quaternions, units, clocks, errors, health counters."""
