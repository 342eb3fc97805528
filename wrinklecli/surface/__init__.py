"""Takes a welded mesh, its rig and the places of tools; gives its rest pose, anchors, paths, strain and refinement.

Triangles are split where an effect needs finer ones. The room knows no effect: an effect asks for split edges through a
`Region`.
"""
