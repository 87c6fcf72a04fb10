//! What a fit cannot draw and the light asset keeps all the same: material extensions, by classes of materials.
//!
//! The rasterizer knows neither coats nor fibres nor glass. Triangles whose materials differ in such things go to
//! different classes, each of which becomes a material of the written file with the extensions of the asset's. What is
//! fitted (base colour, roughness, metalness, normals, emission) lies below them on both sides. Surfaces that transmit
//! light are drawn blended, so that what lies behind them is seen and kept.

use photofit_scene::{
    AlphaMode, Extensions, Instance, Material, Primitive, Scene, SurfacePoints, TextureImage, VertexAttribute,
};
use photofit_shading::Sides;
use std::borrow::Cow;
use std::collections::BTreeMap;

/// Scales that differ by no more than this share are one: nobody sees such a difference in the thickness of glass.
const SAME_SCALE: f32 = 0.05;

/// Share of a surface's light that is drawn although it transmits all of it: its reflections are there. Not measured: enough
/// that the outline and the highlights of clear glass move a loss, little enough that what lies behind it decides.
const LEAST_OPACITY: f32 = 0.25;

/// Materials that become one material of the light asset.
#[derive(Clone, Debug, PartialEq)]
pub struct MaterialClass {
    /// Name of the written material: that of the asset's material, or of the asset where it stands for several.
    pub name: String,
    /// What alpha means in the pictures of a fit.
    pub drawn: AlphaMode,
    /// What alpha means in the written file.
    pub written: AlphaMode,
    /// The sides that are seen, in the pictures and in the written file.
    pub sides: Sides,
    /// Shows its base colour as it is (`KHR_materials_unlit`). While fitting that colour is emission without any
    /// reflection.
    pub unlit: bool,
    /// Vertex normals point to the back of the triangles, as those of the asset do.
    pub opposed: bool,
    /// Share of alpha that is drawn where light passes through: less than the file says, and no parameter.
    pub see_through: Option<f32>,
    /// Extensions of the written material; their textures have become mean values.
    pub extensions: Option<Box<Extensions>>,
}

impl MaterialClass {
    /// Core materials without alpha.
    pub(crate) const PLAIN: Self = Self {
        name: String::new(),
        drawn: AlphaMode::Opaque,
        written: AlphaMode::Opaque,
        sides: Sides::Front,
        unlit: false,
        opposed: false,
        see_through: None,
        extensions: None,
    };

    /// Its name, where the materials that it stands for have these names.
    fn name_of(&self, mut names: Vec<&str>, asset: &str) -> String {
        names.dedup();
        if let [one] = names[..] {
            return one.to_owned();
        }
        let alpha = match self.written {
            AlphaMode::Opaque => "",
            AlphaMode::Mask { .. } => "-mask",
            AlphaMode::Blend => "-blend",
        };
        let unlit = if self.unlit { "-unlit" } else { "" };
        let more = self.extensions.iter().flat_map(|e| e.names()).map(|e| format!("-{e}"));
        format!("{asset}{alpha}{unlit}{}", more.collect::<String>())
    }

    /// Whether light passes through, so that another alpha is drawn than the file has.
    pub fn is_see_through(&self) -> bool {
        self.see_through.is_some()
    }

    /// Alpha in the file of what pictures of a fit draw with this one.
    pub fn written_alpha(&self, drawn: f32) -> f32 {
        match self.see_through {
            Some(_) if self.written == AlphaMode::Opaque => 1.0,
            Some(share) => (drawn / share).min(1.0),
            None => drawn,
        }
    }
}

/// The cutoff of every mask of a light asset: baked alpha is the share of a texel that the asset's mask leaves, so that
/// its outline lies at one half, whatever cutoff the asset's own alpha had.
const MASK: AlphaMode = AlphaMode::Mask { cutoff: 0.5 };

/// The classes of a scene, the plain one first, and the class of each material.
pub(crate) fn classes(scene: &Scene) -> (Vec<MaterialClass>, Vec<u32>) {
    let mut classes = vec![MaterialClass::PLAIN];
    let class = |i: usize| {
        let m = &scene.materials[i];
        let written = match m.alpha_mode {
            AlphaMode::Mask { .. } => MASK,
            mode => mode,
        };
        let extensions = kept(scene, i);
        let see_through = transmits(m).then(|| drawn_share(extensions.as_deref()));
        let drawn = if see_through.is_some() { AlphaMode::Blend } else { written };
        MaterialClass {
            name: String::new(),
            drawn,
            written,
            sides: Sides::of(m.double_sided),
            unlit: m.unlit,
            opposed: false,
            see_through,
            extensions,
        }
    };
    let of: Vec<u32> = (0..scene.materials.len())
        .map(|i| {
            let class = class(i);
            let at = classes.iter().position(|c| *c == class).unwrap_or_else(|| {
                classes.push(class);
                classes.len() - 1
            });
            at as u32
        })
        .collect();
    for (k, class) in classes.iter_mut().enumerate() {
        let own = scene.materials.iter().zip(&of).filter(|(m, c)| **c as usize == k && !m.name.is_empty());
        class.name = class.name_of(own.map(|(m, _)| m.name.as_str()).collect(), &scene.name);
    }
    (classes, of)
}

/// A scene as a fit draws it: surfaces that transmit light are blended. Their alpha is that of the file where it means
/// something there, and 1 where they are opaque to glTF.
pub(crate) fn drawn(scene: &Scene) -> Cow<'_, Scene> {
    if !scene.materials.iter().any(transmits) {
        return Cow::Borrowed(scene);
    }
    let mut out = scene.clone();
    for (i, m) in scene.materials.iter().enumerate().filter(|(_, m)| transmits(m)) {
        let alpha = if m.alpha_mode == AlphaMode::Opaque { 1.0 } else { m.base_color[3] };
        out.materials[i].base_color[3] = alpha * drawn_share(averaged(scene, i).as_ref());
        out.materials[i].alpha_mode = AlphaMode::Blend;
        if let (AlphaMode::Opaque, Some(slot)) = (m.alpha_mode, &mut out.materials[i].base_color_texture)
            && scene.images[slot.image].texels.iter().any(|t| t[3] < 255)
        {
            out.images.push(without_alpha(&scene.images[slot.image]));
            slot.image = out.images.len() - 1;
        }
    }
    Cow::Owned(out)
}

/// The colours of an image.
fn without_alpha(image: &TextureImage) -> TextureImage {
    let mut out = TextureImage { texels16: Vec::new(), encoded: None, ..image.clone() };
    out.texels.iter_mut().chain(out.mips.iter_mut().flatten()).for_each(|t| t[3] = 255);
    out
}

/// Whether light passes through a material, which an alpha mask does not cut out.
pub(crate) fn transmits(m: &Material) -> bool {
    m.transmits() && !matches!(m.alpha_mode, AlphaMode::Mask { .. })
}

/// Share of alpha that is drawn of a material through which light passes, by its extensions without textures: that of the
/// light asset's, whose transmission is the mean of the texture.
fn drawn_share(extensions: Option<&Extensions>) -> f32 {
    let factor = extensions.and_then(|e| e.transmission.as_ref()).map_or(0.0, |t| t.factor);
    1.0 - factor.clamp(0.0, 1.0) * (1.0 - LEAST_OPACITY)
}

/// The extensions of a material, whose textures have become mean values.
fn averaged(scene: &Scene, material: usize) -> Option<Extensions> {
    let extensions = scene.materials[material].extensions.as_ref()?;
    let textured = extensions.textures().next().is_some();
    let points = if textured { scene.surface_points(material) } else { SurfacePoints::default() };
    Some(extensions.averaged(&scene.images, &points))
}

/// The extensions that a material's class keeps.
fn kept(scene: &Scene, material: usize) -> Option<Box<Extensions>> {
    let m = &scene.materials[material];
    if m.unlit {
        return None;
    }
    let mut kept = averaged(scene, material)?;
    // What lets no light pass, as metal, would be glass with the baked maps of a light asset.
    if !m.transmits() {
        (kept.transmission, kept.volume) = (None, None);
    }
    if let Some(volume) = &mut kept.volume {
        volume.thickness *= placed_scale(scene, material);
    }
    (!kept.names().is_empty()).then(|| Box::new(kept))
}

/// By how much an instance scales its mesh, in whose units thickness is: that of a light asset is not scaled.
fn scale(instance: &Instance) -> f32 {
    instance.transform.matrix3.determinant().abs().cbrt()
}

/// The same of a material's first instance.
fn placed_scale(scene: &Scene, material: usize) -> f32 {
    let placed = scene.instances.iter().find(|i| scene.primitives[i.primitive].material == material);
    placed.map_or(1.0, scale)
}

/// A scene that looks the same, in which no material whose thickness matters is placed at several scales: each further scale
/// has a copy of it and of the meshes. What animations name is the scene as it was.
pub(crate) fn apart_by_scale(scene: &Scene) -> Cow<'_, Scene> {
    let mut out = Cow::Borrowed(scene);
    // Each material with a scale, and what stands for it there.
    let mut materials: Vec<(usize, f32, usize)> = Vec::new();
    let mut primitives = BTreeMap::new();
    for (i, instance) in scene.instances.iter().enumerate() {
        let Primitive { material, .. } = scene.primitives[instance.primitive];
        if !has_thickness(&scene.materials[material]) {
            continue;
        }
        let at = scale(instance);
        let same = |of: &&(usize, f32, usize)| of.0 == material && (of.1 - at).abs() <= SAME_SCALE * of.1;
        let copy = materials.iter().find(same).map(|of| of.2).unwrap_or_else(|| {
            let copy = if materials.iter().all(|of| of.0 != material) {
                material
            } else {
                out.to_mut().materials.push(scene.materials[material].clone());
                out.materials.len() - 1
            };
            materials.push((material, at, copy));
            copy
        });
        if copy != material {
            let primitive = *primitives.entry((instance.primitive, copy)).or_insert_with(|| {
                let copied = Primitive { material: copy, ..scene.primitives[instance.primitive].clone() };
                out.to_mut().primitives.push(copied);
                let copy = out.primitives.len() - 1;
                let of = |a: &&VertexAttribute| a.primitive == instance.primitive;
                let attributes = scene.vertex_attributes.iter().filter(of).cloned();
                out.to_mut()
                    .vertex_attributes
                    .extend(attributes.map(|a| VertexAttribute { primitive: copy, ..a }));
                copy
            });
            out.to_mut().instances[i].primitive = primitive;
        }
    }
    out
}

/// Whether light passes through a material by a way that its thickness says.
fn has_thickness(m: &Material) -> bool {
    let volume = m.extensions.as_ref().and_then(|e| e.volume.as_ref());
    transmits(m) && volume.is_some_and(|v| v.thickness > 0.0)
}

/// The materials of a scene for a mesh that is not scaled.
pub(super) fn placed_materials(scene: &Scene) -> Vec<Material> {
    let mut materials = scene.materials.clone();
    for (i, m) in materials.iter_mut().enumerate() {
        if let Some(volume) = m.extensions.as_mut().and_then(|e| e.volume.as_mut()) {
            volume.thickness *= placed_scale(scene, i);
        }
    }
    materials
}

#[cfg(test)]
mod tests {
    use super::*;
    use photofit_geometry::Mesh;
    use photofit_scene::{Clearcoat, Instance, Primitive, TextureImage, Transmission, Volume};

    fn with(extensions: Extensions) -> Material {
        Material { extensions: Some(Box::new(extensions)), ..Material::clay() }
    }

    fn scene() -> Scene {
        let glass = Extensions {
            transmission: Some(Transmission { factor: 1.0, texture: None }),
            volume: Some(Volume { thickness: 0.5, ..Volume::default() }),
            ..Extensions::default()
        };
        let coat = Extensions {
            clearcoat: Some(Clearcoat { factor: 0.5, ..Clearcoat::default() }),
            ..Extensions::default()
        };
        let mask = |cutoff| Material { alpha_mode: AlphaMode::Mask { cutoff }, ..Material::default() };
        let unlit = Material { unlit: true, ..Material::default() };
        let materials = vec![
            Material::clay(),
            with(glass),
            with(coat.clone()),
            mask(0.25),
            mask(0.75),
            with(coat),
            unlit,
            with(Extensions::default()),
        ];
        Scene {
            primitives: (0..materials.len())
                .map(|material| Primitive { material, ..Primitive::default() })
                .collect(),
            instances: (0..materials.len())
                .map(|primitive| Instance {
                    primitive,
                    transform: glam::Affine3A::from_scale(glam::Vec3::splat(2.0)),
                })
                .collect(),
            materials,
            images: vec![TextureImage::default()],
            ..Scene::default()
        }
    }

    #[test]
    fn materials_that_differ_in_extensions_or_alpha_are_told_apart() {
        let (classes, of) = classes(&scene());
        assert_eq!(of, [0, 1, 2, 3, 3, 2, 4, 0]);
        assert_eq!(classes.len(), 5);
        let thickness = classes[1].extensions.as_ref().unwrap().volume.as_ref().unwrap().thickness;
        assert!((thickness - 1.0).abs() < 1e-6, "scaled as it is placed");
        let stage = crate::engine::judge::Stage::of_mesh("own", &scene(), &Mesh::default(), &[]);
        let own = stage.scene.materials[1].extensions.as_ref().unwrap().volume.as_ref().unwrap().thickness;
        assert!((own - 1.0).abs() < 1e-6, "in files with the asset's own materials too");
        assert_eq!(
            classes[3].written,
            AlphaMode::Mask { cutoff: 0.5 },
            "where baked coverage has its outline"
        );
        assert!(classes[4].unlit && classes[4].extensions.is_none() && !classes[3].unlit);
        let see_through: Vec<bool> = classes.iter().map(MaterialClass::is_see_through).collect();
        assert_eq!(see_through, [false, true, false, false, false]);
    }

    #[test]
    fn glass_is_see_through_whatever_its_alpha_means() {
        for (alpha_mode, written) in [(AlphaMode::Opaque, 1.0), (AlphaMode::Blend, 0.8)] {
            let mut s = scene();
            (s.materials[1].alpha_mode, s.materials[1].base_color[3]) = (alpha_mode, 0.8);
            let (classes, of) = classes(&s);
            let class = &classes[of[1] as usize];
            assert!(class.is_see_through() && class.written == alpha_mode);
            let shown = drawn(&s).materials[1].base_color[3];
            assert!((class.written_alpha(shown) - written).abs() < 1e-6, "{alpha_mode:?}: {shown}");
        }
        assert!((MaterialClass::PLAIN.written_alpha(0.3) - 0.3).abs() < 1e-6);
    }

    #[test]
    fn glass_has_a_class_for_each_scale() {
        assert!(matches!(apart_by_scale(&scene()), Cow::Borrowed(_)), "all is at one scale");
        let mut scene = scene();
        // The coat of a clay has no thickness; glass has.
        for (primitive, by) in [(1, 1.0), (1, 2.04), (1, 1.02), (2, 1.0)] {
            let transform = glam::Affine3A::from_scale(glam::Vec3::splat(by));
            scene.instances.push(Instance { primitive, transform });
        }
        let apart = apart_by_scale(&scene);
        assert_eq!((apart.materials.len(), apart.primitives.len()), (9, 9));
        let (classes, of) = classes(&apart);
        let thickness = |m: usize| {
            classes[of[m] as usize].extensions.as_ref().unwrap().volume.as_ref().unwrap().thickness
        };
        assert!((thickness(1) - 1.0).abs() < 1e-6 && (thickness(8) - 0.5).abs() < 1e-6);
        let shown = |scene: &Scene| {
            let of =
                |i: &Instance| (i.transform, scene.materials[scene.primitives[i.primitive].material].clone());
            scene.instances.iter().map(of).collect::<Vec<_>>()
        };
        assert_eq!(shown(&apart), shown(&scene));
    }

    #[test]
    fn materials_that_differ_in_their_sides_are_told_apart() {
        let of = |double_sided| Material { double_sided, ..Material::clay() };
        let scene = Scene { materials: vec![of(true), of(false), of(true)], ..Scene::default() };
        let (classes, of) = classes(&scene);
        assert_eq!(of, [1, 0, 1]);
        assert_eq!(classes.iter().map(|c| c.sides).collect::<Vec<_>>(), [Sides::Front, Sides::Both]);
    }

    #[test]
    fn glass_is_drawn_blended_and_nothing_else_changes() {
        let before = scene();
        let after = drawn(&before);
        assert_eq!(after.materials[1].alpha_mode, AlphaMode::Blend);
        assert!((after.materials[1].base_color[3] - LEAST_OPACITY).abs() < 1e-6);
        let others = (0..before.materials.len()).filter(|i| *i != 1);
        assert!(others.into_iter().all(|i| after.materials[i] == before.materials[i]));
        let mut opaque = Scene { materials: vec![Material::clay()], ..Scene::default() };
        assert!(matches!(drawn(&opaque), Cow::Borrowed(_)));
        // Metal lets no light pass, nor does its class, whose metalness is a map.
        opaque.materials = vec![Material { metallic: 1.0, ..scene().materials[1].clone() }];
        assert!(matches!(drawn(&opaque), Cow::Borrowed(_)));
        let (classes, _) = classes(&opaque);
        assert!(!classes[0].is_see_through() && classes[0].extensions.is_none());
    }
}
