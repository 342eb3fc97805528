"""An asset and its tools in, a proven file out: the job, its plan, sampling, encoding, proof and report.

This room puts the others together for `wrinkle bake` and `wrinkle track`. It does not know the command line, nor how
results are shown to people.
"""
