"""Muscles: from origin to insertion below the skin, of constant volume, which bulge as they shorten."""
