"""Takes a surface, a tool and a drive; gives a few fixed shapes in bind space and their weights over time.

Each effect has a folder. Effects act in one order, and each sees the body as the effects before it have moved it. The
room reads and writes no file, and does not know how shapes and weights are stored.
"""
