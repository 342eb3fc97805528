"""Assets in, pictures out: a sheet or an animation, traced by rays without a display."""
