"""Bytes in, a `Document` out; a changed document in, complete files out.

This room knows the glTF container: JSON, buffers, accessors, compression, images. What a skin does or a wrinkle is, it
must not know.
"""
