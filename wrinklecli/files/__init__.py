"""Reads bytes from paths, and writes files either all or none.

This room does not know what the files contain. Every command writes through it.
"""
