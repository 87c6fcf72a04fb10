"""Total variation: scikit-image's Chambolle beside ours, in the suite `denoise` (tv_chambolle.py)."""

from harness import suite_with_python

ABOUT = "Total variation against scikit-image"
NEEDS = ["numpy", "scikit-image"]


def table():
    return suite_with_python("denoise")
