"""A surface, what moves it and its tools in; a finer surface, shapes and heights of wrinkles out: the paper's method.

C. Larboulette, M.-P. Cani, *Real-Time Dynamic Wrinkles*, Computer Graphics International 2004. This room reads and
writes no file, and does not know how shapes and heights are stored.
"""
