"""Takes a welded mesh, its rig and the places of tools; gives what lies on the mesh at rest, and how the mesh deforms.

The room holds the rest pose, anchors, paths, strain, and the refinement that splits triangles where an effect needs
finer ones. It knows no effect: an effect asks for split edges through a `Region`.
"""
