"""What people look at before and after a bake: inspect, check, suggest, preview, diff.

Assets come in; text, tables and pictures go out. Nothing here writes an asset, and nothing in `baking` needs it.
"""
