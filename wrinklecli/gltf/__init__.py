"""Turns bytes into a `Document`, and a changed document into complete files.

This room knows the glTF container: JSON, buffers, accessors, compression, images. It must not know what a skin or a
wrinkle is.
"""
