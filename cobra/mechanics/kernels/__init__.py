"""The chain of SRC-Bot compiled by numba: geometry, articulated-body solve, cables, stops, and the march through time.

`chain.py` and `friction.py` say the same in plain NumPy and are the tests' oracle; `dynamics.py` is the public face.

The kernels know plain arrays only, one row a segment, with named columns (`layout.py`): arrays inside tuples, and views of
rows, cost numba an atomic reference count at every use, which took longer than the arithmetic. Six-vectors are written out
in scalars, because numba would reload arrays after every store and take half a minute to compile unrolled loops.
"""
