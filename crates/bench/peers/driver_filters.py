"""Sparse Cholesky and the bilateral filter: cholespy and Numba beside ours, in the suite `filters` (large_steps_cholespy.py, bilateral_numba.py)."""

from harness import suite_with_python

ABOUT = "Large Steps against cholespy, and the bilateral filter against Numba"
NEEDS = ["numpy", "scipy", "cholespy", "numba"]


def table():
    return suite_with_python("filters")
