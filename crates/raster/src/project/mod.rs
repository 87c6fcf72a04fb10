//! Model-view-projection of vertex positions to clip space, and its adjoint.

#[cfg(feature = "gpu")]
pub mod gpu;

use glam::Mat4;
use photofit_scalar::{Real, Vec3, Vec4, vec3, vec4};
use rayon::prelude::*;

/// Vertices handled by one task.
const CHUNK: usize = 4096;

/// A 4x4 matrix of scalars, row by row.
pub type Matrix4<T> = [[T; 4]; 4];

/// Rows of a glam matrix in another scalar.
pub fn matrix_rows<T: Real>(m: &Mat4) -> Matrix4<T> {
    let r = [m.row(0), m.row(1), m.row(2), m.row(3)];
    r.map(|v| v.to_array().map(|x| T::of(f64::from(x))))
}

/// `clip[i] = m (p[i], 1)`: `[V]` positions to `[V]` clip-space positions.
///
/// # Panics
/// If `clip` is not as long as `positions`.
pub fn project<T: Real>(m: &Matrix4<T>, positions: &[Vec3<T>], clip: &mut [Vec4<T>]) {
    assert_eq!(positions.len(), clip.len(), "one clip position per vertex");
    clip.par_chunks_mut(CHUNK).zip(positions.par_chunks(CHUNK)).for_each(|(c, p)| {
        for (c, p) in c.iter_mut().zip(p) {
            let row = |r: &[T; 4]| r[0] * p.x + r[1] * p.y + r[2] * p.z + r[3];
            *c = vec4(row(&m[0]), row(&m[1]), row(&m[2]), row(&m[3]));
        }
    });
}

/// Adjoint of [`project`] with respect to the positions: `g_p += M^T g_clip` (upper 3 rows), accumulating.
///
/// # Panics
/// If the slices differ in length.
pub fn project_vjp<T: Real>(m: &Matrix4<T>, g_clip: &[Vec4<T>], g_positions: &mut [Vec3<T>]) {
    assert_eq!(g_clip.len(), g_positions.len(), "one gradient per vertex");
    g_positions.par_chunks_mut(CHUNK).zip(g_clip.par_chunks(CHUNK)).for_each(|(gp, gc)| {
        for (gp, gc) in gp.iter_mut().zip(gc) {
            let col = |k: usize| m[0][k] * gc.x + m[1][k] * gc.y + m[2][k] * gc.z + m[3][k] * gc.w;
            *gp += vec3(col(0), col(1), col(2));
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use photofit_gradcheck::{Uniform, check};

    #[test]
    fn gradient_of_the_projection() {
        let mut rng = Uniform::new(1);
        let mut m = [[0.0; 4]; 4];
        m.iter_mut().flatten().for_each(|x| *x = rng.range(-1.0, 1.0));
        let (x, w) = (rng.vec(15, -1.0, 1.0), rng.vec(20, -1.0, 1.0));
        let run = |x: &[f64]| {
            let mut clip = vec![Vec4::zero(); 5];
            project(&m, bytemuck::cast_slice(x), &mut clip);
            clip.iter().zip(w.chunks(4)).map(|(c, w)| c.dot(vec4(w[0], w[1], w[2], w[3]))).sum()
        };
        let mut g = vec![Vec3::zero(); 5];
        project_vjp(&m, bytemuck::cast_slice(&w), &mut g);
        check("project", &x, bytemuck::cast_slice(&g), 1e-5, 1e-8, run);
    }
}
