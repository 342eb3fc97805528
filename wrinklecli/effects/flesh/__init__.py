"""Flesh: soft regions that swing after the joint that carries them.

Takes regions of a body and its motion; gives for each region a few shapes and their weights, by a spring for each.
"""
