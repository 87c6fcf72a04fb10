//! Where a world point falls in the picture of a frame.

/// The projection of one frame: `(x w, y w, w) = world_to_pixel (X, Y, Z, 1)`, pixel centres at +.5, y down, `w > 0` in
/// front of the camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// Three rows of four.
    pub world_to_pixel: [[f64; 4]; 3],
}

impl Camera {
    /// Pixel coordinates of a point; `None` behind the camera.
    #[inline]
    pub fn project(&self, p: [f32; 3]) -> Option<[f64; 2]> {
        let [x, y, w] = self
            .world_to_pixel
            .map(|r| r[0] * f64::from(p[0]) + r[1] * f64::from(p[1]) + r[2] * f64::from(p[2]) + r[3]);
        (w > 1e-9).then(|| [x / w, y / w])
    }

    /// World positions of pixels whose distance from the camera is known (0 where the ray meets nothing); `None` if
    /// the matrix has no inverse.
    pub fn positions(&self, depth: &[f32], width: usize) -> Option<Vec<f32>> {
        let inverse = invert(self.world_to_pixel.map(|r| [r[0], r[1], r[2]]))?;
        let apply = |v: [f64; 3]| inverse.map(|r| r[0] * v[0] + r[1] * v[1] + r[2] * v[2]);
        let origin = apply(self.world_to_pixel.map(|r| -r[3]));
        let n = depth.len();
        let mut out = vec![0.0; 3 * n];
        for (i, z) in depth.iter().enumerate().filter(|(_, z)| **z > 0.0) {
            let d = apply([(i % width) as f64 + 0.5, (i / width) as f64 + 0.5, 1.0]);
            let t = f64::from(*z) / (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt();
            (0..3).for_each(|c| out[c * n + i] = (origin[c] + t * d[c]) as f32);
        }
        Some(out)
    }

    /// Distances from the camera from depths along its axis (0 where the ray meets nothing); `None` if the matrix has no
    /// inverse.
    pub fn distances(&self, along_axis: &[f32], width: usize) -> Option<Vec<f32>> {
        let inverse = invert(self.world_to_pixel.map(|r| [r[0], r[1], r[2]]))?;
        let [a, b, c] = [self.world_to_pixel[2][0], self.world_to_pixel[2][1], self.world_to_pixel[2][2]];
        // A ray scaled to 1 in w advances by this much along the axis.
        let per_axis = (a * a + b * b + c * c).sqrt();
        let length = |i: usize| {
            let v = [(i % width) as f64 + 0.5, (i / width) as f64 + 0.5, 1.0];
            let d = inverse.map(|r| r[0] * v[0] + r[1] * v[1] + r[2] * v[2]);
            (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt() * per_axis
        };
        Some(along_axis.iter().enumerate().map(|(i, z)| (f64::from(*z) * length(i)) as f32).collect())
    }

    /// Distance of a point from the plane of the camera's centre, in the units of `w`: the scale of depth tests.
    #[inline]
    pub(crate) fn depth(&self, p: [f32; 3]) -> f64 {
        let r = self.world_to_pixel[2];
        let w = r[0] * f64::from(p[0]) + r[1] * f64::from(p[1]) + r[2] * f64::from(p[2]) + r[3];
        w.abs() / (r[0] * r[0] + r[1] * r[1] + r[2] * r[2]).sqrt().max(1e-30)
    }
}

fn invert(m: [[f64; 3]; 3]) -> Option<[[f64; 3]; 3]> {
    let cofactor = |i: usize, j: usize| {
        let (a, b, c, d) = ((i + 1) % 3, (i + 2) % 3, (j + 1) % 3, (j + 2) % 3);
        m[a][c] * m[b][d] - m[a][d] * m[b][c]
    };
    let determinant: f64 = (0..3).map(|j| m[0][j] * cofactor(0, j)).sum();
    let scale: f64 = m.iter().map(|r| r.iter().map(|v| v * v).sum::<f64>().sqrt()).product();
    if determinant.is_nan() || determinant.abs() <= 1e-12 * scale {
        return None;
    }
    Some(std::array::from_fn(|i| std::array::from_fn(|j| cofactor(j, i) / determinant)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn positions_project_back_to_their_pixels() {
        let camera = Camera {
            world_to_pixel: [[-40.0, 3.0, 16.0, 50.0], [1.0, -41.0, 12.0, 30.0], [0.01, 0.02, 1.0, 3.0]],
        };
        let depth: Vec<f32> = (0..12).map(|i| if i == 5 { 0.0 } else { 1.0 + 0.3 * i as f32 }).collect();
        let p = camera.positions(&depth, 4).expect("an invertible camera");
        for i in (0..12).filter(|i| *i != 5) {
            let [x, y] = camera.project([p[i], p[12 + i], p[24 + i]]).expect("in front");
            let expected = [(i % 4) as f64 + 0.5, (i / 4) as f64 + 0.5];
            assert!((x - expected[0]).abs() < 1e-4 && (y - expected[1]).abs() < 1e-4, "{i}: {x} {y}");
        }
        assert_eq!((p[5], p[17], p[29]), (0.0, 0.0, 0.0));
        // The same points from their depths along the axis.
        let along: Vec<f32> = (0..12)
            .map(|i| if i == 5 { 0.0 } else { camera.depth([p[i], p[12 + i], p[24 + i]]) as f32 })
            .collect();
        let distances = camera.distances(&along, 4).expect("an invertible camera");
        assert!(distances.iter().zip(&depth).all(|(a, b)| (a - b).abs() < 1e-4), "{distances:?} {depth:?}");
        assert_eq!(Camera { world_to_pixel: [[0.0; 4]; 3] }.positions(&depth, 4), None);
    }
}
