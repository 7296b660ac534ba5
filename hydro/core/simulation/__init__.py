"""The motion of a vehicle with its effects, and what drives and disturbs a simulated one."""
