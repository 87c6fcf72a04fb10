"""Total variation by scikit-image's `denoise_tv_chambolle`, as an independent peer.

tv_chambolle.py PICTURE.f32 ROWS COLS LAMBDA REPETITIONS ITERATIONS...: one plane of little-endian floats. Prints one line
for each number of iterations: the relative primal-dual gap, then the seconds of each repetition. Needs numpy and
scikit-image.

The peer minimises |u - f|^2 / (2 weight) + |grad u|, which is ours with lambda = 1 / weight. Its estimate is f minus the
divergence of a dual field that it keeps below 1, so the estimate alone tells the dual energy
lambda/2 (|f|^2 - |u|^2), and with it the gap |grad u| + lambda <u, u - f>, in double precision.
"""

import sys
import time

import numpy as np
from skimage.restoration import denoise_tv_chambolle


def relative_gap(u, f, scale):
    u, f = u.astype(np.float64), f.astype(np.float64)
    dx, dy = np.zeros_like(u), np.zeros_like(u)
    dx[:, :-1], dy[:-1] = np.diff(u, axis=1), np.diff(u, axis=0)
    variation = np.sqrt(dx * dx + dy * dy).sum()
    primal = variation + 0.5 * scale * ((u - f) ** 2).sum()
    return (variation + scale * (u * (u - f)).sum()) / primal


def main():
    rows, cols, scale = int(sys.argv[2]), int(sys.argv[3]), float(sys.argv[4])
    f = np.fromfile(sys.argv[1], np.float32).reshape(rows, cols)
    repetitions = int(sys.argv[5])
    for iterations in map(int, sys.argv[6:]):
        seconds = []
        for _ in range(repetitions):
            start = time.perf_counter()
            u = denoise_tv_chambolle(f, weight=1 / scale, eps=0, max_num_iter=iterations)
            seconds.append(time.perf_counter() - start)
        print(relative_gap(u, f, scale), *seconds)


if __name__ == "__main__":
    main()
