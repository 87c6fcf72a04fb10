"""Differentiable rasterization of vertex-coloured meshes: DEODR, and our suites `colors` and `gradients` (a map of colours, through the pass of the fit) on the same shapes."""

import time

import numpy as np

from harness import WORK, markdown, median_seconds, sphere, suite_by_cpu, write_ply

ABOUT = "Vertex colours, forward and reverse, and gradients at silhouettes, against DEODR on one thread"
NEEDS = ["numpy", "scipy", "typing_extensions", "trimesh", "deodr"]

SIZE = 512
# Of the gradients, as in our suite: side of the picture, samples along a side, of the truth too, motions and weightings.
SMALL, SAMPLES, TRUTH, MOTIONS, WEIGHTINGS = 32, (1, 2, 4, 8), 64, 6, 8
STEP = 0.01


def scene_of(vertices, triangles, colors):
    """A scene of one mesh that shines in its colours, before black."""
    import deodr

    mesh = deodr.ColoredTriMesh(
        faces=triangles.astype(np.int64), vertices=vertices.astype(np.float64), clockwise=False, nb_colors=3, colors=colors
    )
    scene = deodr.Scene3D(sigma=1)
    scene.set_mesh(mesh)
    scene.set_background_color(np.zeros(3))
    scene.set_light(light_directional=None, light_ambient=1.0)
    return scene, mesh


def times():
    """CPU milliseconds of forward and reverse."""
    from deodr import differentiable_renderer as dr

    rows, paths = [], []
    for frequency in (16, 71):
        vertices, triangles = sphere(frequency)
        paths.append(WORK / f"vertex-color-{len(triangles)}.ply")
        write_ply(paths[-1], vertices, triangles)
        directions = vertices / np.linalg.norm(vertices, axis=1, keepdims=True)
        scene, _ = scene_of(vertices, triangles, 0.5 + 0.5 * directions.astype(np.float64))
        # x to the right, y down, looking along z.
        camera = dr.PerspectiveCamera(SIZE, SIZE, 45.0, np.array([0, 0, 3.0]), np.diag([1.0, -1.0, -1.0]))

        def both():
            image = scene.render(camera)
            scene.clear_gradients()
            scene.render_backward(2 * (image - 0.25))

        # The first render makes what the gradients are cleared in.
        scene.render(camera)
        whole = median_seconds(both, clock=time.process_time)
        # The compiled parts alone, without what Python does around them.
        flat, image, depth = scene.scene_2d, np.empty((SIZE, SIZE, 3)), np.empty((SIZE, SIZE))
        seed = 2 * (scene.render(camera) - 0.25)

        def parts():
            dr.renderScene(flat, scene.sigma, image, depth)
            flat.clear_gradients()
            dr.renderSceneB(flat, scene.sigma, image.copy(), depth, seed.copy())

        rows.append([len(triangles), 1e3 * whole, 1e3 * median_seconds(parts, clock=time.process_time)])
    ours = suite_by_cpu("colors", PHOTOFIT_BENCH_MESHES=":".join(map(str, paths)))
    table = []
    for count, whole, parts in rows:
        own = 1e3 * ours["both, 1 thread(s)", f"{count} tri, {SIZE}^2"]["seconds"]
        table.append([f"{count:,}", own, whole, parts, own / whole, own / parts])
    head = ["triangles", "ours", "DEODR", "its compiled parts", "ours / DEODR", "ours / compiled parts"]
    return markdown(head, table)


def number(place, salt):
    """The hash of the suite, -1 to 1."""
    mask = (1 << 64) - 1
    x = place * 0x9E3779B97F4A7C15 + salt & mask
    x = (x ^ x >> 30) * 0xBF58476D1CE4E5B9 & mask
    x = (x ^ x >> 27) * 0x94D049BB133111EB & mask
    return ((x ^ x >> 31) >> 40) / (1 << 23) - 1.0


def weights():
    pixels = SMALL * SMALL
    all_of = [number((w * 4096 + i) * 3 + c, 1) for w in range(WEIGHTINGS) for i in range(pixels) for c in range(3)]
    return np.array(all_of).reshape(WEIGHTINGS, SMALL, SMALL, 3)


def motion(d, p):
    h = [number(d * 31 + k, 7) for k in range(11)]
    x, y, z = p.T
    return np.stack(
        [
            h[0] + h[1] * x + h[2] * y + h[3] * z,
            h[4] + h[5] * x + h[6] * y + h[7] * z,
            0.5 * (h[8] + h[9] * x + h[10] * y),
        ],
        1,
    )


def torus(around, across, radius, tube):
    u, v = (a.reshape(-1) for a in np.meshgrid(np.arange(around), np.arange(across), indexing="ij"))
    a, b = 2 * np.pi * u / around, 2 * np.pi * v / across
    ring = radius + tube * np.cos(b)
    points = np.stack([ring * np.cos(a), ring * np.sin(a), tube * np.sin(b)], 1)
    at = lambda i, j: i % around * across + j % across
    quads = [at(u, v), at(u + 1, v), at(u + 1, v + 1), at(u, v + 1)]
    return points, np.concatenate([np.stack([quads[k] for k in half], 1) for half in ([0, 1, 2], [0, 2, 3])])


def shapes():
    """The five cases of the suite; `dense` has other bumps."""
    x, y = np.array([[-1, -1], [1, -1], [-1, 1], [1, 1]], float).T
    two = np.array([[0, 1, 3], [0, 3, 2]])
    quad = np.stack([0.7 * x - 0.2 * y, 0.7 * y + 0.2 * x, 0 * x], 1)
    thin = np.stack([x, 0.021 * y + 0.3 * x, 0 * x], 1)
    tilted = np.stack([0.9 * x, 0.9 * y, 0.5 * x], 1)
    points, triangles = sphere(40, 0.1, 3)
    p, faces = torus(24, 12, 0.7, 0.3)
    return {
        "quad": (quad, two),
        "dense": (0.9 * points.astype(float), triangles),
        "thin": (thin, two),
        "crossing": (np.concatenate([quad, tilted]), np.concatenate([two, two + 4])),
        "fold": (np.stack([p[:, 0], 0.6 * p[:, 1] + 0.5 * p[:, 2], 0.8 * p[:, 2]], 1), faces),
    }


def errors(vertices, triangles, seeds):
    """Relative errors of DEODR's gradients by samples along a side, against differences of its own picture."""
    from deodr import differentiable_renderer as dr

    eye = np.array([0.1, 0.2, 3.0])
    ahead = -eye / np.linalg.norm(eye)
    right = np.cross(ahead, [0, 1, 0])
    right /= np.linalg.norm(right)
    turn = np.stack([right, -np.cross(right, ahead), ahead])
    camera = lambda side: dr.PerspectiveCamera(side, side, np.degrees(0.8), eye, turn)
    u, v = vertices[:, 0] + 0.5 * vertices[:, 2], 0.4 * vertices[:, 2] - vertices[:, 1]
    colors = 0.5 + 0.4 * np.stack([np.sin(3 * u + 0.4), np.cos(2 * v - 0.7), np.sin(2.5 * (u + v))], 1)

    def mean_picture(moved):
        scene, _ = scene_of(moved, triangles, colors)
        # No blur of its own at edges.
        scene.sigma = 1e-3
        image = scene.render(camera(SMALL * TRUTH))
        return image.reshape(SMALL, TRUTH, SMALL, TRUTH, 3).mean((1, 3))

    truth = []
    for d in range(MOTIONS):
        plus, minus = (mean_picture(vertices + s * motion(d, vertices)) for s in (STEP, -STEP))
        truth += [(w * (plus - minus)).sum() / (2 * STEP) for w in seeds]
    truth, out = np.array(truth), []
    for k in SAMPLES:
        scene, mesh = scene_of(vertices, triangles, colors)
        scene.render(camera(SMALL * k))
        gradients = []
        for w in seeds:
            scene.clear_gradients()
            scene.render_backward(w.repeat(k, 0).repeat(k, 1) / k**2)
            gradients.append(np.array(mesh._vertices_b))
        found = np.array([(motion(d, vertices) * g).sum() for d in range(MOTIONS) for g in gradients])
        out.append(float(np.linalg.norm(found - truth) / np.linalg.norm(truth)))
    return out


def silhouettes():
    """Relative errors of position gradients, ours and DEODR's."""
    ours, seeds, rows = suite_by_cpu("gradients"), weights(), []
    for name, (vertices, triangles) in shapes().items():
        theirs = errors(vertices, triangles, seeds)
        own = [ours[name, f"{k} x {k} samples"]["figures"]["error"] for k in SAMPLES]
        rows.append([name, *(f"{a:.2f}, {b:.2f}" for a, b in zip(own, theirs))])
        print(rows[-1], flush=True)
    return markdown(["case", *(f"{k * k}" for k in SAMPLES)], rows)


def table():
    return (
        f"CPU milliseconds of forward and reverse, {SIZE} x {SIZE} pixels. Ours draws a map of colours with antialiasing, DEODR"
        f" colours of vertices:\n\n{times()}\n\nRelative error of position gradients by samples a pixel, ours and DEODR's, each"
        f" against central differences of its own picture of {TRUTH**2} samples a pixel:\n\n{silhouettes()}"
    )
