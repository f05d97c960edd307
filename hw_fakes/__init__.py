"""A fake MPU-6050: the chip as behaviour in virtual or real time, and buses around it."""
