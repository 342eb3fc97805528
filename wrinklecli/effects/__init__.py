"""A surface, a tool and a drive in; a few fixed shapes in bind space and their weights over time out.

One folder for each effect. Effects act in one order, and each sees the body as those before it have moved it. This
room reads and writes no file, and does not know how shapes and weights are stored.
"""
