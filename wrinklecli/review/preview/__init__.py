"""Assets in, pictures out: a contact sheet or an animation, traced by rays without a display."""
