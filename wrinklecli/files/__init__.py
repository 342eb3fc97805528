"""Paths in, bytes out; bytes in, files that are all there or none.

What the files hold, this room does not know. Every command writes through it.
"""
