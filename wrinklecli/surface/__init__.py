"""A welded mesh, its rig and where a tool is asked for in; what lies on the mesh at rest, and how it deforms, out.

The rest pose, anchors, paths, strain, and the refinement that splits triangles where an effect needs them. This room
knows no effect: what asks for split edges is a `Region`, whatever it is.
"""
