"""The page of `wrinkle edit`: a session as widgets and pictures in the browser, and what people do there as its edits.

Only here viser is imported, which serves the page and draws it.
"""
