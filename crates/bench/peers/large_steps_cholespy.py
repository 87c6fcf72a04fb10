"""Factorisation and solve of Large Steps' matrix I + lambda L by cholespy (CHOLMOD), as an independent peer.

large_steps_cholespy.py EDGES.u32 VERTICES LAMBDA POSITIONS.f64 [REPETITIONS]: EDGES holds pairs of vertices, POSITIONS
three numbers per vertex, both little-endian. Solves for the positions from their image under the matrix, in double
precision and then in single, and prints one line for each: the relative error, the seconds of each factorisation, then
those of each solve. Needs numpy, scipy and cholespy.
"""

import sys
import time

import numpy as np
import scipy.sparse as sp
from cholespy import CholeskySolverD, CholeskySolverF, MatrixType


def main():
    edges = np.fromfile(sys.argv[1], np.uint32).reshape(-1, 2).astype(np.int64)
    n, scale = int(sys.argv[2]), float(sys.argv[3])
    x = np.fromfile(sys.argv[4], np.float64).reshape(n, 3)
    repetitions = int(sys.argv[5]) if len(sys.argv) > 5 else 5
    adjacency = sp.coo_matrix((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), (n, n)).tocsr()
    adjacency = ((adjacency + adjacency.T) > 0).astype(np.float64)
    laplacian = sp.diags(np.asarray(adjacency.sum(1)).ravel()) - adjacency
    matrix = (sp.identity(n) + scale * laplacian).tocoo()
    rows, columns = matrix.row.astype(np.int32), matrix.col.astype(np.int32)
    right = matrix @ x
    for solver_type, scalar in [(CholeskySolverD, np.float64), (CholeskySolverF, np.float32)]:
        factor, solve = [], []
        b = np.ascontiguousarray(right, scalar)
        found = np.zeros_like(b)
        for _ in range(repetitions):
            start = time.perf_counter()
            solver = solver_type(n, rows, columns, matrix.data, MatrixType.COO)
            factor.append(time.perf_counter() - start)
            for _ in range(5):
                start = time.perf_counter()
                solver.solve(b, found)
                solve.append(time.perf_counter() - start)
            del solver
        error = np.linalg.norm(found - x) / np.linalg.norm(x)
        print(error, *factor, *solve)


main()
