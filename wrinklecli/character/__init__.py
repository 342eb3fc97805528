"""Takes a `Document` and gives the character in it as arrays: rig, clips, poses, welded surface, scene.

This room knows no tools and no wrinkles: `weight_track` joins weights of new morph targets with those of a clip,
whatever the targets are for.
"""
