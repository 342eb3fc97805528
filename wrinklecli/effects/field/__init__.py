"""Fields: whole garments that wrinkle where their own compression says, across its direction.

Takes a surface and the turns of joints; gives a few shapes, and their weights by the joints' angles.
"""
