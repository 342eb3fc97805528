"""Arrays in, arrays out: vectors, nearest points, subdivision, signals over time.

Every function here would serve a program without glTF or wrinkles just as well, so nothing here may know of an asset,
a tool or a file.
"""
