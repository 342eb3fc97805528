"""A rig and a clip in; numbers over time out: signals, springs and the weights that follow from them.

What drives an effect, in a bake and in the players that read `extras.wrinkle`. This room knows joints and morph
targets, but no triangles and no shapes.
"""
