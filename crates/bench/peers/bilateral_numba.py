"""The edge-avoiding a-trous filter of two moments of a 512 x 512 x 4 texture in Numba, as an independent peer.

bilateral_numba.py {three|b3} OURS.f32 [REPETITIONS]: makes the inputs of the `optim` suite, filters, compares with the
moments in OURS.f32, and prints the largest difference, then the seconds of each repetition. Needs numpy and numba.
"""

import sys
import time

import numba
import numpy as np

NX = NY = 512
C = 4
SIGMA = 0.05


def scrambled(i):
    x = (i.astype(np.uint64) * np.uint64(0x9E3779B1)).astype(np.uint32)
    x ^= x >> np.uint32(15)
    x = (x.astype(np.uint64) * np.uint64(0x85EBCA77)).astype(np.uint32)
    x ^= x >> np.uint32(13)
    return (x >> np.uint32(8)).astype(np.float32) / np.float32(1 << 24)


@numba.njit(parallel=True, fastmath=True, boundscheck=False)
def level(theta, m, v, om, ov, taps, stride, scale):
    r = len(taps) // 2
    ny, nx, c = theta.shape
    for y in numba.prange(ny):
        sm = np.zeros(4, np.float32)
        sv = np.zeros(4, np.float32)
        for x in range(nx):
            total = np.float32(0)
            for k in range(4):
                sm[k] = 0
                sv[k] = 0
            for ky in range(len(taps)):
                yy = y + (ky - r) * stride
                if yy < 0 or yy >= ny:
                    continue
                for kx in range(len(taps)):
                    xx = x + (kx - r) * stride
                    if xx < 0 or xx >= nx:
                        continue
                    d = np.float32(0)
                    for k in range(4):
                        e = theta[yy, xx, k] - theta[y, x, k]
                        d += e * e
                    w = taps[ky] * taps[kx] * np.exp(-np.sqrt(d) * scale)
                    total += w
                    for k in range(4):
                        sm[k] += w * m[yy, xx, k]
                        sv[k] += w * v[yy, xx, k]
            for k in range(4):
                om[y, x, k] = sm[k] / total
                ov[y, x, k] = sv[k] / total


def filtered(theta, m, v, taps, buffers):
    scale = np.float32(1 / SIGMA)
    for a in range(5):
        om, ov = buffers[a % 2]
        level(theta, m, v, om, ov, taps, 1 << a, scale)
        m, v = om, ov
    return m, v


def main():
    taps = {"three": [1, 2, 1], "b3": [1, 4, 6, 4, 1]}[sys.argv[1]]
    taps = np.array(taps, np.float32) / np.float32(sum(taps))
    i = np.arange(NX * NY * C)
    site = i // C
    block = (site % NX // 50) * 7 + (site // NX // 50) * 3 + i % C
    shape = (NY, NX, C)
    theta = ((block % 10).astype(np.float32) * np.float32(0.1) + np.float32(0.02) * scrambled(i)).reshape(shape)
    m = (scrambled(i + 77) - np.float32(0.5)).reshape(shape)
    v = m * m
    buffers = [(np.empty_like(m), np.empty_like(m)) for _ in range(2)]
    times = []
    for _ in range(int(sys.argv[3]) + 1 if len(sys.argv) > 3 else 11):
        start = time.perf_counter()
        om, ov = filtered(theta, m, v, taps, buffers)
        times.append(time.perf_counter() - start)
    ours = np.fromfile(sys.argv[2], np.float32).reshape(2, *shape)
    print(max(np.abs(ours[0] - om).max(), np.abs(ours[1] - ov).max()), *times[1:])


main()
