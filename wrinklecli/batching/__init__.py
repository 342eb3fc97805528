"""Bake every job of a manifest: find the jobs that changed, hand them to workers, and report each outcome.

This room calls `baking` for each job, in this process or on workers of Dask, and keeps a cache of finished outputs. It
does not know how a bake works, nor how outcomes are shown to people.
"""
