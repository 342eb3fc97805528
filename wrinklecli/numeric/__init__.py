"""Arrays in, arrays out: vectors, nearest points, subdivision, signals over time.

All of it would serve a program without glTF or wrinkles: nothing here may know what an asset or a tool holds, and only
messages mention them. `guard` sets the conditions under which all arithmetic runs.
"""
