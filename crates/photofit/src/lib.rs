//! photofit fits 3D assets to images: this crate re-exports its parts under features.
//!
//! | feature | module | contents | brings |
//! |---|---|---|---|
//! | always | [`scalar`] | the scalar trait and small vectors | |
//! | `image` | `image` | image buffers, colour, metrics | |
//! | `image-files` | `image` | reading and writing PNG, JPEG, WebP, Radiance and OpenEXR | `image` |
//! | `ktx2` | `ktx2` | KTX 2.0 textures: an encoder of UASTC, a decoder | |
//! | `texture` | `texture` | mip pyramids, filters and their adjoints | |
//! | `sampling` | `sampling` | counter-based random numbers, warps | |
//! | `geometry` | `geometry` | meshes, normals, tangents, Laplacians, decimation, atlas | |
//! | `shading` | `shading` | surfaces, lights and their derivatives | |
//! | `optim` | `optim` | optimizers on plain slices | |
//! | `optim-mesh`, `optim-fft` | `optim` | diffusion over meshes (brings faer), over grids (brings an FFT) | `optim` |
//! | `flow` | `flow` | learned importance sampling: normalizing flows, lobe mixtures | `optim`, `sampling` |
//! | `denoise` | `denoise` | variational denoising, surfaces from points | `image` |
//! | `scene` | `scene` | cameras, materials; glTF, OBJ and PLY files | `image-files`, `geometry`, `shading`, `texture` |
//! | `raster` | `raster` | the differentiable rasterizer | `geometry`, `shading`, `texture` |
//! | `rays` | `rays` | ray hierarchies, watertight intersection, closest points | |
//! | `pathtrace` | `pathtrace` | path tracing | `rays`, `scene` |
//! | `fit` (default) | `fit` | the tasks: simplify, bake, compare, report | all but `ktx2` |
//! | `gpu` | `fit`, `denoise` | fits that stay on a GPU, convex models of the denoiser | `fit` |
//!
//! Features only add. With `default-features = false` and one feature a crate gets that part and what it stands on.
//!
#![cfg_attr(
    feature = "fit",
    doc = r#"
```
use photofit::fit::{Silent, simplify::{SimplifyOptions, simplify}};
use photofit::geometry::{decimate::Target, shapes};
use photofit::scene::{Instance, Material, Primitive, Scene};

// A rock of 1,280 triangles; an asset from a file would be `photofit::scene::load("rock.glb")?`.
let rock = Scene {
    primitives: vec![Primitive { mesh: shapes::displaced_sphere(8, 0.2, 3, 1), material: 0 }],
    instances: vec![Instance { primitive: 0, transform: Default::default() }],
    materials: vec![Material::clay()],
    ..Scene::default()
};
let options = SimplifyOptions {
    target: Target::Triangles(200),
    resolution: 32,
    texture_size: 32,
    steps: 4,
    batch: 1,
    report_views: 1,
    ..SimplifyOptions::default()
};
let file = std::env::temp_dir().join(format!("photofit-example-{}.glb", std::process::id()));
let outcome = simplify(&rock, &file, &options, &Silent)?;
assert!(outcome.triangles_out <= 200);
assert!(outcome.shipped().is_some_and(|q| q.psnr > 10.0));
# std::fs::remove_file(&file)?;
# Ok::<(), Box<dyn std::error::Error>>(())
```
"#
)]

pub use photofit_scalar as scalar;

#[cfg(feature = "denoise")]
pub use photofit_denoise as denoise;
#[cfg(feature = "fit")]
pub use photofit_fit as fit;
#[cfg(feature = "flow")]
pub use photofit_flow as flow;
#[cfg(feature = "geometry")]
pub use photofit_geometry as geometry;
#[cfg(feature = "image")]
pub use photofit_image as image;
#[cfg(feature = "ktx2")]
pub use photofit_ktx2 as ktx2;
#[cfg(feature = "optim")]
pub use photofit_optim as optim;
#[cfg(feature = "pathtrace")]
pub use photofit_pathtrace as pathtrace;
#[cfg(feature = "raster")]
pub use photofit_raster as raster;
#[cfg(feature = "rays")]
pub use photofit_rays as rays;
#[cfg(feature = "sampling")]
pub use photofit_sampling as sampling;
#[cfg(feature = "scene")]
pub use photofit_scene as scene;
#[cfg(feature = "shading")]
pub use photofit_shading as shading;
#[cfg(feature = "texture")]
pub use photofit_texture as texture;
