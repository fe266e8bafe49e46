"""Way gone and speed, made of wheel pulses and an inertial sensor, with the error that is vouched for."""
