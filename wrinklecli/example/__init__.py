"""Room of the demo, which bakes and draws a character of its own.

In: `figure.glb`, which `samples/make_samples.py` makes, and its tools. Out: a folder with both, their bake and a
picture. The room must not know the command line.
"""
