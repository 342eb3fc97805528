"""A `Document` in; out comes what moves in it, as arrays: rig, clips, poses, welded surface, scene.

This is the character as the animator left it. This room knows no tools and no wrinkles: `weight_track` joins weights of
new morph targets with a clip's own, whatever these targets are for.
"""
