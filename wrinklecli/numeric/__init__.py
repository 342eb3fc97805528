"""Arrays in, arrays out: vectors, nearest points, subdivision, signals over time; and the guard around computing.

Every function here would serve a program without glTF or wrinkles just as well, so nothing here may know what an asset
or a tool holds. (`guard` names them, in its messages alone.)
"""
