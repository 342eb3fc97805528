"""A surface, its tools and their shortening in; shapes and heights of wrinkles out: the paper's method.

C. Larboulette, M.-P. Cani, *Real-Time Dynamic Wrinkles*, Computer Graphics International 2004. This room reads and
writes no file, and does not know how a wrinkle is stored.
"""
