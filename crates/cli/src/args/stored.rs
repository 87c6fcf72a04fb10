//! How textures, their mip levels and geometry are stored in a written file.

use clap::ValueEnum;

/// How textures are stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum TextureFormat {
    /// Exact, for every reader.
    Png,
    /// Lossy; textures with alpha stay PNG.
    Jpeg,
    /// Exact.
    Webp,
    /// Lossy, about a third of the bytes of jpeg; colours at half resolution, alpha exact.
    WebpLossy,
    /// Blocks that graphics processors keep compressed (UASTC), with mip levels made for them; PNG for images whose sides are
    /// no multiples of 4.
    Ktx2,
    /// No textures: colours of vertices, everything else the same all over a material.
    None,
}

/// How geometry is stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum GeometryFormat {
    /// As it is, for every reader.
    None,
    /// Compressed, positions rounded to 2^-15 of the size of the smallest part, normals to .06 degrees.
    Meshopt,
    /// Compressed, positions rounded to 2^-14, normals to 1.3 degrees: about a sixth fewer bytes of geometry.
    MeshoptMedium,
    /// Compressed, positions rounded to 2^-13, normals to 1.3 degrees.
    MeshoptCoarse,
}

/// How mip levels of new textures come about.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum MipLevels {
    /// Each averages the one before it, as readers of other formats do by themselves.
    Classic,
    /// Each has texels of its own.
    Free,
}
