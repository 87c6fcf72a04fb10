//! Variational denoising of images and depth maps, Monte Carlo denoising, and surfaces from points.
