"""Room of characters that are made by code, and of the demo, which bakes and draws one.

In: nothing but code. Out: skinned and textured characters as glTF, and a folder with one, its tools and its bake.
The samples of the repository are made with the same modules. The room must not know the command line.
"""
