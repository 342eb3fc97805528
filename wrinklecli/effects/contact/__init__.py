"""Contact: where a fold would pass through itself or another mesh, the surface gives way.

Not in the paper, which names contact as a goal.
"""
