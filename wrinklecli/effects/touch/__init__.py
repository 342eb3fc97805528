"""Touch: a tip that sticks to the skin drags it along, and rings of wrinkles rise in front of it.

Takes places on a body and the slides that a clip keys there; gives for each place two shapes of the slide, a dent, and
the rings in a few windows of directions, with their weights.
"""
