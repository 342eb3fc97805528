"""YAML text in, frozen `WrinkleTool` records out, or every problem of the file at once with its line.

This room knows what a tool may say. It does not know the asset: whether a node, a clip or a morph target exists is for
later rooms to find out.
"""
