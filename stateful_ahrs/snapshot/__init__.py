"""Snapshots: one accelerometer and one magnetometer sample → rotor, without memory."""
