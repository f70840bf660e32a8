"""The MPU-9250: registers, transports, and a simulator that answers register by register."""
