"""`wrinkle edit`: draw tools on a mesh, tune them while it moves, and save the tools file.

An asset and a tools file come in; the same file goes out, changed only where it was edited. A session does not know the
page, and the page does not know the method; all wrinkles are computed by the functions of a bake.
"""
