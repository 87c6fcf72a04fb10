"""Optimal energies of small problems by an independent interior-point solver.

Needs cvxpy and Clarabel: `pip install cvxpy clarabel`, then `python optima.py` rewrites optima.json beside this file.
The problems are made from formulas that `crates/denoise/src/admm/tests/problems.rs` repeats; beside each optimum stands the energy of
a probe image, by which the tests check that both sides mean the same problem.
"""

import json
import os

import cvxpy as cp
import numpy as np
import scipy.sparse as sp

M = N = 32
MASK = (1 << 64) - 1
GOLDEN = 0x9E3779B97F4A7C15


def mix(z):
    z = ((z ^ (z >> 30)) * 0xBF58476D1CE4E5B9) & MASK
    z = ((z ^ (z >> 27)) * 0x94D049BB133111EB) & MASK
    return z ^ (z >> 31)


def uniform(stream, index, seed=7):
    """The counter-based generator of crates/sampling."""
    first = mix(mix((seed + GOLDEN) & MASK) ^ ((stream * GOLDEN) & MASK))
    rot = ((GOLDEN << 32) | (GOLDEN >> 32)) & MASK
    second = mix(first ^ ((stream + rot) & MASK))
    bits = mix(mix((index * GOLDEN + first) & MASK) ^ second)
    return (bits >> 11) / float(1 << 53)


def clean(channel):
    """A disc with a shaded inside on a ramp with a step."""
    i, j = np.mgrid[0:M, 0:N].astype(float)
    disc = ((i - 15) ** 2 + (j - 13) ** 2 < 81).astype(float)
    ramp = 0.3 * j / 31 + 0.1 * i / 31
    step = np.where(i + j > 44, 0.25, 0.0)
    return 0.2 + ramp * (1 - 0.2 * channel) + (0.4 - 0.01 * i) * disc + step * (1 + 0.3 * channel)


def noise(stream):
    return np.array([[uniform(stream, i * N + j) - 0.5 for j in range(N)] for i in range(M)])


NOISE = 0.1 * np.sqrt(12.0)
GRAY = clean(0) + NOISE * noise(0)
RGB = np.stack([clean(c) + NOISE * noise(c) for c in range(3)])
SEEN = (noise(10) + 0.5 >= 0.4).astype(float)
OUTLIERS = np.where(noise(11) + 0.5 < 0.05, 1.0, GRAY)


def difference(n):
    """Forward difference with natural boundary: no row for the last sample."""
    return sp.diags([-np.ones(n - 1), np.ones(n - 1)], [0, 1], shape=(n - 1, n))


def pad(matrix, before, after):
    """Zero rows where the mask excludes a component."""
    k = matrix.shape[1]
    return sp.vstack([sp.csr_matrix((before, k)), matrix, sp.csr_matrix((after, k))])


I_M, I_N = sp.identity(M), sp.identity(N)
DX = sp.kron(I_M, pad(difference(N), 0, 1)).tocsr()
DY = sp.kron(pad(difference(M), 0, 1), I_N).tocsr()
SECOND = difference(N - 1) @ difference(N)
HXX = sp.kron(I_M, pad(SECOND, 1, 1)).tocsr()
HYY = sp.kron(pad(difference(M - 1) @ difference(M), 1, 1), I_N).tocsr()
HXY = sp.kron(pad(difference(M), 0, 1), pad(difference(N), 0, 1)).tocsr()

TRUE_G = np.concatenate([DX @ clean(0).ravel(), DY @ clean(0).ravel()])
G = TRUE_G + 0.02 * np.concatenate([noise(20).ravel(), noise(21).ravel()])
GX, GY = G[: M * N], G[M * N :]
MASK_X = (np.arange(M * N) % N < N - 1).astype(float)
MASK_Y = (np.arange(M * N) // N < M - 1).astype(float)


def field(rows):
    """Rows of expressions as a matrix whose columns are the vectors of the pixels."""
    return cp.vstack(rows)


def norms(rows):
    return cp.norm(field(rows), 2, axis=0)


def grad(u):
    return [DX @ u, DY @ u]


def hess(u):
    return [HXX @ u, np.sqrt(2.0) * (HXY @ u), HYY @ u]


def guided(u):
    return [cp.multiply(MASK_X, DX @ u - GX), cp.multiply(MASK_Y, DY @ u - GY)]


def l2(u, f, weight):
    return 0.5 * cp.sum(cp.multiply(weight, cp.square(u - f)))


def l1(u, f, weight):
    return cp.sum(cp.multiply(weight, cp.abs(u - f)))


def one_sided(u, f, weight, delta):
    """weight * (square for r >= -delta, line below), as an infimal convolution on the negative side."""
    r = u - f
    negative, rest = cp.Variable(r.size, nonneg=True), cp.Variable(r.size)
    # r = rest - negative; the line costs delta per unit of `negative`.
    value = cp.sum(cp.multiply(weight, 0.5 * cp.square(rest) + delta * negative))
    return value, [r == rest - negative]


def solve(name, variables, energy, constraints=()):
    problem = cp.Problem(cp.Minimize(energy), list(constraints))
    problem.solve(solver=cp.CLARABEL, tol_gap_abs=1e-11, tol_gap_rel=1e-11, tol_feas=1e-11)
    optimum = float(problem.value)
    print(f"{name:18} {problem.status:10} {optimum:.12g}")
    return optimum


def main():
    results = {}
    gray, seen, outliers = GRAY.ravel(), SEEN.ravel(), OUTLIERS.ravel()
    ones = np.ones(M * N)
    probe = clean(0).ravel()
    probe3 = [clean(c).ravel() for c in range(3)]

    def gray_case(name, make):
        u = cp.Variable(M * N)
        made = make(u)
        energy, constraints = made if isinstance(made, tuple) else (made, [])
        optimum = solve(name, u, energy, constraints)
        u.value = probe
        if constraints:
            v = cp.Variable(M * N)
            e, c = make(v)
            at_probe = float(cp.Problem(cp.Minimize(e), c + [v == probe]).solve(solver=cp.CLARABEL))
        else:
            at_probe = float(energy.value)
        results[name] = {"optimum": optimum, "probe": at_probe}

    gray_case("rof", lambda u: l2(u, gray, 8 * ones) + cp.sum(norms(grad(u))))
    gray_case("rof_holes", lambda u: l2(u, gray, 8 * seen) + cp.sum(norms(grad(u))))
    gray_case("tv_l1", lambda u: l1(u, gray, 1.2 * ones) + cp.sum(norms(grad(u))))
    gray_case("tv_l1_holes", lambda u: l1(u, gray, 1.2 * seen) + cp.sum(norms(grad(u))))
    gray_case(
        "htv_l2_holes",
        lambda u: l2(u, gray, 8 * seen) + 0.5 * cp.sum(norms(grad(u))) + cp.sum(norms(hess(u))),
    )
    gray_case(
        "htv_l2_n_holes",
        lambda u: l2(u, gray, 8 * seen)
        + 0.1 * cp.sum(norms(grad(u)))
        + 0.5 * cp.sum(norms(hess(u)))
        + cp.sum(norms(guided(u))),
    )
    gray_case(
        "htv_l1_n_holes",
        lambda u: l1(u, outliers, 1.2 * seen)
        + 0.1 * cp.sum(norms(grad(u)))
        + 0.5 * cp.sum(norms(hess(u)))
        + cp.sum(norms(guided(u))),
    )
    gray_case(
        "hybrid_n_holes",
        lambda u: l1(u, outliers, 0.6 * seen)
        + l2(u, outliers, 4 * seen)
        + 0.1 * cp.sum(norms(grad(u)))
        + 0.5 * cp.sum(norms(hess(u)))
        + cp.sum(norms(guided(u))),
    )

    def huber(u):
        value, constraints = one_sided(u, outliers, 8 * seen, 0.05)
        return value + 0.2 * cp.sum(norms(grad(u))) + 0.5 * cp.sum(norms(hess(u))), constraints

    gray_case("huber_holes", huber)
    gray_case(
        "beltrami",
        lambda u: l2(u, gray, 8 * 5 * ones) + cp.sum(norms([np.ones((M * N)), 5 * (DX @ u), 5 * (DY @ u)])),
    )

    def rgb_case(name, make):
        u = [cp.Variable(M * N) for _ in range(3)]
        energy = make(u)
        optimum = solve(name, u, energy)
        for v, p in zip(u, probe3):
            v.value = p
        results[name] = {"optimum": optimum, "probe": float(energy.value)}

    alpha = 0.1 * (0.2 + 0.8 * (np.arange(M * N) % N) / (N - 1))

    def mc(u):
        data = sum(l1(u[c], RGB[c].ravel(), 0.1 * ones) + l2(u[c], RGB[c].ravel(), 0.5 * ones) for c in range(3))
        return data + cp.sum(cp.multiply(alpha, norms(sum((grad(v) for v in u), []))))

    rgb_case("mc_hybrid", mc)
    rgb_case(
        "rof_vectorial",
        lambda u: sum(l2(u[c], RGB[c].ravel(), 8 * ones) for c in range(3))
        + cp.sum(norms(sum((grad(v) for v in u), []))),
    )

    u, w1, w2 = cp.Variable(M * N), cp.Variable(M * N), cp.Variable(M * N)
    # Symmetrised derivative by backward differences where both neighbours exist and inside the border.
    j, i = np.arange(M * N) % N, np.arange(M * N) // N
    in_x, in_y = ((j > 0) & (j < N - 1)).astype(float), ((i > 0) & (i < M - 1)).astype(float)
    back_x, back_y = -DX.T, -DY.T
    strain = [
        cp.multiply(in_x, back_x @ w1),
        cp.multiply(in_y, back_y @ w2),
        np.sqrt(0.5) * cp.multiply(in_x * in_y, back_y @ w1 + back_x @ w2),
    ]
    first = cp.sum(norms([cp.multiply(MASK_X, DX @ u - w1), cp.multiply(MASK_Y, DY @ u - w2)]))
    tgv = l2(u, gray, 8 * ones) + first + 2 * cp.sum(norms(strain))
    optimum = solve("tgv2", u, tgv)
    u.value, w1.value, w2.value = probe, DX @ probe, DY @ probe
    results["tgv2"] = {"optimum": optimum, "probe": float(tgv.value)}

    path = os.path.join(os.path.dirname(os.path.abspath(__file__)), "optima.json")
    with open(path, "w") as out:
        json.dump(results, out, indent=1, sort_keys=True)
        out.write("\n")


if __name__ == "__main__":
    main()
