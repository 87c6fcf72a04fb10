"""Differentiable rasterization of vertex-coloured meshes: DEODR, and our suite `colors` (a map of colours, through the pass of the fit) on the same meshes."""

import numpy as np

from harness import WORK, markdown, median_seconds, sphere, suite, write_ply

ABOUT = "Vertex colours, forward and reverse, against DEODR on one thread"
NEEDS = ["numpy", "typing_extensions", "deodr"]

SIZE = 512


def table():
    import deodr
    from deodr import differentiable_renderer as dr

    rows, paths = [], []
    for frequency in (16, 71):
        vertices, triangles = sphere(frequency)
        paths.append(WORK / f"vertex-color-{len(triangles)}.ply")
        write_ply(paths[-1], vertices, triangles)
        directions = vertices / np.linalg.norm(vertices, axis=1, keepdims=True)
        mesh = deodr.ColoredTriMesh(
            faces=triangles.astype(np.int64), vertices=vertices.astype(np.float64), clockwise=False, nb_colors=3,
            colors=0.5 + 0.5 * directions.astype(np.float64),
        )
        scene = deodr.Scene3D(sigma=1)
        scene.set_mesh(mesh)
        scene.set_background_color(np.zeros(3))
        scene.set_light(light_directional=None, light_ambient=1.0)
        # x to the right, y down, looking along z.
        camera = dr.PerspectiveCamera(SIZE, SIZE, 45.0, np.array([0, 0, 3.0]), np.diag([1.0, -1.0, -1.0]))

        def both():
            image = scene.render(camera)
            scene.clear_gradients()
            scene.render_backward(2 * (image - 0.25))

        # The first render makes what the gradients are cleared in.
        scene.render(camera)
        whole = median_seconds(both)
        # The compiled parts alone, without what Python does around them.
        flat, image, depth = scene.scene_2d, np.empty((SIZE, SIZE, 3)), np.empty((SIZE, SIZE))
        seed = 2 * (scene.render(camera) - 0.25)

        def compiled():
            dr.renderScene(flat, scene.sigma, image, depth)
            flat.clear_gradients()
            dr.renderSceneB(flat, scene.sigma, image.copy(), depth, seed.copy())

        rows.append([len(triangles), 1e3 * whole, 1e3 * median_seconds(compiled)])
    suite("colors", PHOTOFIT_BENCH_MESHES=":".join(map(str, paths)))
    ours = (WORK.parents[1] / "colors.md").read_text().split("\n", 1)[1].strip()
    head = ["triangles", "DEODR, ms", "its compiled parts, ms"]
    return f"{markdown(head, rows)}\n\nOurs, the same meshes, pictures of {SIZE} x {SIZE}:\n\n{ours}"
