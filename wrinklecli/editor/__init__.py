"""`wrinkle edit`: tools drawn on a mesh and tuned while it moves, and saved as the tools file that is baked.

An asset and a tools file come in; the same file goes out, changed where it was edited and nowhere else. The session
knows no page, the page no method; nothing of a bake is done here in another way than a bake does it.
"""
