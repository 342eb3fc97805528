"""Wrinkles: a control curve of constant length raises bumps where the ends of a segment come closer.

Source: C. Larboulette, M.-P. Cani, *Real-Time Dynamic Wrinkles*, Computer Graphics International 2004.
"""
