"""The page of `wrinkle edit`: it shows a session in the browser, and turns clicks and drags into edits.

Only this folder imports viser, which serves and draws the page.
"""
