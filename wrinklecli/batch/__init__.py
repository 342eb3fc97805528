"""A manifest in, many bakes out: what to bake, what of it is new, who bakes it, and what came of each.

This room runs the bakes of `baking`, one at a time here or many at once by Dask, and takes from a cache what was baked
before. It does not know how a bake is made, nor how outcomes are shown to people.
"""
