"""Contact: the surface gives way where a fold would pass through itself or another mesh.

Not in the paper, which names contact as a goal.
"""
