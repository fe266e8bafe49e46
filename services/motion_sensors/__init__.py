"""Inertial sensors and pulse counters: read live or from logs, time-stamped, watched, calibrated."""
