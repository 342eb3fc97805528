"""Wrinkle maps: normal, height and occlusion maps with masks for each weight, for meshes that stay as they are."""
