"""The MPU-6050 itself: registers, power, samples, FIFO, interrupts, auxiliary bus."""
