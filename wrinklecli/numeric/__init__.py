"""Arrays in, arrays out: vectors, nearest points, subdivision, signals over time.

All of it would serve a program without glTF or wrinkles just as well: nothing here may know what an asset or a tool
holds, and only messages speak of them. `guard` is no arithmetic; it says under which conditions all arithmetic runs.
"""
