//! What an asset holds besides surfaces, and what of it a simplified asset keeps.

use crate::{AssetInfo, Hierarchy, Scene};
use std::collections::BTreeSet;

impl Scene {
    /// Takes over what an asset made from another keeps of it: cameras and lights in world space, and what the file says
    /// about itself. Lights that throw pictures, which glTF has not got, are left out.
    pub fn inherit(&mut self, asset: &Self) {
        self.cameras.clone_from(&asset.cameras);
        self.lights = asset.lights.iter().filter(|l| !l.throws_picture()).cloned().collect();
        self.about = asset.about.clone();
    }

    /// What the scene holds and an asset that was simplified from it, usually to one mesh for each class of materials, does not: one
    /// line each, none for a plain scene. An empty scene stands for one that takes nothing over.
    pub fn left_out(&self, light: &Self) -> Vec<String> {
        let mut out = Vec::new();
        for (have, kept, what) in [
            (self.cameras.len(), light.cameras.len(), "camera"),
            (self.lights.len(), light.lights.len(), "light"),
        ] {
            if kept < have {
                out.push(count(have - kept, what));
            }
        }
        if self.about != light.about && self.about != AssetInfo::default() {
            out.push("what the file says about itself (copyright, name of the scene, extras)".into());
        }
        if let Some(h) = self.hierarchy.as_deref() {
            h.left_out(light.hierarchy.as_deref().unwrap_or(&Hierarchy::default()), &mut out);
        }
        let of = |scene: &Self| -> BTreeSet<&'static str> {
            let extensions = scene.materials.iter().filter_map(|m| m.extensions.as_ref());
            extensions.flat_map(|e| e.textures()).map(|(name, _)| name).collect()
        };
        let averaged = &of(self) - &of(light);
        if !averaged.is_empty() {
            let list = averaged.into_iter().collect::<Vec<_>>().join(", ");
            out.push(format!("textures of material extensions, which become their means: {list}"));
        }
        let occluded = self.materials.iter().filter(|m| m.occlusion_texture.is_some()).count();
        if occluded > 0 && light.materials.iter().all(|m| m.occlusion_texture.is_none()) {
            out.push(format!("occlusion maps of {}", count(occluded, "material")));
        }
        let of = |scene: &Self| scene.extras() - scene.about.extras();
        let extras = (of(self) + self.ignored_extras).saturating_sub(of(light));
        if extras > 0 {
            out.push(format!("application data (extras) of {}", count(extras, "object")));
        }
        let read = self.vertex_attributes.iter().filter(|_| light.vertex_attributes.is_empty());
        let read = read.map(|a| format!("_{}", a.name));
        let attributes: BTreeSet<String> = read.chain(self.ignored_attributes.iter().cloned()).collect();
        if !attributes.is_empty() {
            let names = names(attributes.iter().map(String::as_str));
            out.push(format!("{}{names}", count(attributes.len(), "vertex attribute")));
        }
        if !self.ignored_extensions.is_empty() {
            let names = names(self.ignored_extensions.iter().map(String::as_str));
            out.push(format!(
                "{} that are not read{names}",
                count(self.ignored_extensions.len(), "extension")
            ));
        }
        out
    }

    /// Objects with application data.
    pub(crate) fn extras(&self) -> usize {
        let of_materials = self.materials.iter().filter(|m| m.extras.is_some()).count();
        let of_images = self.images.iter().filter(|i| i.extras.is_some()).count();
        let of_scene = self.about.extras() + of_materials + of_images;
        let Some(h) = self.hierarchy.as_deref() else { return of_scene };
        let lists = [
            h.nodes.iter().filter(|n| n.extras.is_some()).count(),
            h.meshes.iter().filter(|m| m.extras.is_some()).count(),
            h.meshes.iter().flat_map(|m| &m.primitives).filter(|p| p.extras.is_some()).count(),
            h.skins.iter().filter(|s| s.extras.is_some()).count(),
            h.animations.iter().filter(|a| a.extras.is_some()).count(),
            h.cameras.iter().filter(|c| c.extras.is_some()).count(),
            h.lights.iter().filter(|l| l.extras.is_some()).count(),
        ];
        of_scene + lists.iter().sum::<usize>()
    }
}

impl AssetInfo {
    /// Those of the file, its asset and its scene that have application data.
    fn extras(&self) -> usize {
        [&self.asset_extras, &self.root_extras, &self.scene_extras].into_iter().flatten().count()
    }
}

impl Hierarchy {
    /// What nodes hold and those of `light` do not.
    fn left_out(&self, light: &Self, out: &mut Vec<String>) {
        let less = |of: &dyn Fn(&Self) -> usize| of(self).saturating_sub(of(light));
        let joints = |h: &Self| h.skins.iter().map(|s| s.joints.len()).sum();
        let skins = less(&|h| h.skins.len());
        if skins > 0 {
            let joints = count(less(&joints), "joint");
            out.push(format!("{} with {joints}: the default pose stays", count(skins, "skin")));
        }
        let targets = less(&|h| h.meshes.iter().map(|m| m.targets()).sum());
        if targets > 0 {
            out.push(format!("{}: the default weights stay", count(targets, "morph target")));
        }
        let animations = less(&|h| h.animations.len());
        if animations > 0 {
            let kept: BTreeSet<&str> = light.animations.iter().map(|a| a.name.as_str()).collect();
            let lost = self.animations.iter().map(|a| a.name.as_str()).filter(|name| !kept.contains(name));
            let names = names(lost);
            out.push(format!("{}{names}", count(animations, "animation")));
        }
        if less(&|h| h.nodes.iter().filter(|n| !n.children.is_empty()).count()) > 0 {
            let nodes = count(self.nodes.len(), "node");
            out.push(format!("the hierarchy of {nodes}: their transforms are worked into the vertices"));
        }
        let there: BTreeSet<&str> = light.names().collect();
        let lost = self.names().filter(|name| !name.is_empty() && !there.contains(name)).count();
        if lost > 0 {
            out.push(format!("{} of nodes and meshes", count(lost, "name")));
        }
        let parallel = less(&|h| h.nodes.iter().filter_map(|n| n.camera).count() - h.cameras_shown());
        if parallel > 0 {
            out.push(format!("{} that are orthographic or not shown", count(parallel, "camera")));
        }
    }

    /// Of nodes and meshes.
    fn names(&self) -> impl Iterator<Item = &str> {
        self.nodes.iter().map(|n| n.name.as_str()).chain(self.meshes.iter().map(|m| m.name.as_str()))
    }

    /// Pinhole cameras that are shown.
    fn cameras_shown(&self) -> usize {
        self.cameras_and_lights(&self.locals()).0.len()
    }
}

fn count(n: usize, what: &str) -> String {
    format!("{n} {what}{}", if n == 1 { "" } else { "s" })
}

/// The first names in brackets.
fn names<'a>(all: impl Iterator<Item = &'a str>) -> String {
    let clip = |n: &str| n.chars().filter(|c| !c.is_control()).take(40).collect::<String>();
    let mut names: Vec<String> = all.filter(|n| !n.is_empty()).map(clip).collect();
    let more = names.len() > 8;
    names.truncate(8);
    match (names.is_empty(), more) {
        (true, _) => String::new(),
        (_, true) => format!(" ({}, ...)", names.join(", ")),
        (_, false) => format!(" ({})", names.join(", ")),
    }
}
