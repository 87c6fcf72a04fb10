"""MeshLab's edge collapses in a process of their own, since it crashes on some assets: `HEAVY.obj LIGHT.obj TRIANGLES textured|plain`."""

import sys

import pymeshlab

# Status where MeshLab refuses; Python's own errors have 1.
REFUSED = 3


def main(heavy, light, budget, textured):
    work = pymeshlab.MeshSet()
    work.load_new_mesh(heavy)
    end = "_with_texture" if textured == "textured" and work.current_mesh().has_wedge_tex_coord() else ""
    collapse = getattr(work, f"meshing_decimation_quadric_edge_collapse{end}")
    try:
        collapse(targetfacenum=int(budget), preservenormal=True, optimalplacement=True)
    except pymeshlab.PyMeshLabException as e:
        print(e, file=sys.stderr)
        sys.exit(REFUSED)
    work.save_current_mesh(light)


if __name__ == "__main__":
    main(*sys.argv[1:])
