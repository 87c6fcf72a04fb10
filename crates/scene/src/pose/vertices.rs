//! The vertices of a scene's bind pose: how those of a pose follow from them, and other ones in their place.

use super::NodesAt;
use crate::nodes::{Hierarchy, Placement};
use crate::{Primitive, Scene};
use glam::Affine3A;
use photofit_geometry::skinning::{Affine, Deformation};
use photofit_scalar::Vec3f;
use std::collections::BTreeSet;
use std::sync::Arc;

impl Scene {
    /// What a moment (see [`Scene::pose`]) does to the vertices of the bind pose: from the frame of the primitive of each to
    /// the world, where [`Scene::flatten`] has them at that moment, in the same order: one instance after the other, and of
    /// each the vertices of its primitive.
    ///
    /// # Errors
    /// The rule that is broken: a primitive that has no normals in its bind pose, or a normal map without tangents (its
    /// vertices may be split then), or whose triangles the moment turns inside out against the default pose.
    ///
    /// # Panics
    /// As [`Scene::pose`].
    pub fn deformation(&self, animation: Option<usize>, time: f32) -> Result<Deformation, String> {
        assert!(!time.is_nan(), "a time is a number");
        let hierarchy = self.hierarchy.as_deref();
        assert!(animation.is_none() || hierarchy.is_some(), "the scene has no animations");
        let at = hierarchy.map(|h| NodesAt::new(h, animation, time));
        let rest = hierarchy.map(|h| NodesAt::new(h, None, 0.0));
        let mirrored = |transform: Affine3A| Affine::from(transform).normals().mirrored;
        let mut all = Deformation::default();
        for (i, instance) in self.instances.iter().enumerate() {
            let primitive = instance.primitive;
            self.check_normals(i)?;
            if self.splits(primitive) {
                return Err(format!("primitive {primitive} has a normal map, but no tangents"));
            }
            let count = self.primitives[primitive].mesh.positions.len();
            let placement = hierarchy.and_then(|h| h.placements.get(i));
            let part = at.as_ref().zip(placement).map(|(at, placement)| at.part(placement));
            let (transform, bind) = part.unwrap_or((instance.transform, None));
            let at_rest = rest.as_ref().zip(placement).map(|(at, placement)| at.part(placement).0);
            if at_rest.is_some_and(|at_rest| mirrored(at_rest) != mirrored(transform)) {
                return Err(format!("primitive {primitive} is turned inside out at {time} s"));
            }
            let own = bind.map_or_else(Deformation::default, |(bind, w, joints)| bind.deformation(w, joints));
            let first = all.moves.len();
            let transform = Affine::from(transform);
            let moves = |v: usize| own.moves.get(v).map_or(transform, |m| m.then(&transform));
            all.moves.extend((0..count).map(moves));
            for (to, from) in [(&mut all.positions, own.positions), (&mut all.normals, own.normals)] {
                if !from.is_empty() {
                    to.resize(first, Vec3f::zero());
                    to.extend(from);
                }
            }
        }
        let count = all.moves.len();
        for added in [&mut all.positions, &mut all.normals].into_iter().filter(|a| !a.is_empty()) {
            added.resize(count, Vec3f::zero());
        }
        Ok(all)
    }

    /// Whether [`Scene::set_bind_vertices`] can change the vertices of the bind pose; else why not.
    ///
    /// # Errors
    /// The rule that is broken: a primitive, or a part of a mesh that nodes deform, that is placed more than once, or has no
    /// normals in its bind pose.
    pub fn check_bind_vertices(&self) -> Result<(), String> {
        let (mut primitives, mut parts) = (BTreeSet::new(), BTreeSet::new());
        for (i, instance) in self.instances.iter().enumerate() {
            let primitive = instance.primitive;
            if !primitives.insert(primitive) {
                return Err(format!("primitive {primitive} is placed more than once"));
            }
            // Nodes that deform the same part have a primitive each.
            if let Some((hierarchy, Placement { node, part })) = self.placement(i)
                && let Some(mesh) = hierarchy.nodes[node].mesh
                && !parts.insert((mesh, part))
            {
                return Err(format!("primitive {part} of mesh {mesh} is placed more than once"));
            }
            self.check_normals(i)?;
        }
        Ok(())
    }

    /// What places an instance; `None` for those added by hand.
    fn placement(&self, instance: usize) -> Option<(&Hierarchy, Placement)> {
        let hierarchy = self.hierarchy.as_deref()?;
        Some((hierarchy, *hierarchy.placements.get(instance)?))
    }

    /// Whether the bind pose of an instance has normals; else the rule.
    fn check_normals(&self, instance: usize) -> Result<(), String> {
        let primitive = self.instances[instance].primitive;
        let bind = self.placement(instance).and_then(|(hierarchy, placement)| hierarchy.bind(&placement));
        let mesh = bind.map_or(&self.primitives[primitive].mesh, |bind| &bind.mesh);
        if mesh.normals.len() == mesh.positions.len() {
            Ok(())
        } else {
            Err(format!("primitive {primitive} has no normals"))
        }
    }

    /// Whether [`Scene::flatten`] makes tangents for a primitive, which may split its vertices.
    fn splits(&self, primitive: usize) -> bool {
        let Primitive { mesh, material } = &self.primitives[primitive];
        mesh.tangents.is_empty()
            && !mesh.positions.is_empty()
            && self.materials[*material].normal_texture.is_some()
    }

    /// Puts positions and unit normals in place of those of the bind pose, each in the frame of its primitive: one of each per
    /// vertex, one instance after the other. Tangents of the old ones and what morph targets add to them are dropped; the
    /// scene stands in its default pose then.
    ///
    /// # Panics
    /// If [`Scene::check_bind_vertices`] is an error, or there is not one of each per vertex.
    pub fn set_bind_vertices(&mut self, positions: &[Vec3f], normals: &[Vec3f]) {
        let checked = self.check_bind_vertices();
        assert!(checked.is_ok(), "{checked:?}");
        let mut first = 0;
        for (i, instance) in self.instances.iter().enumerate() {
            let mesh = &mut self.primitives[instance.primitive].mesh;
            let range = first..first + mesh.positions.len();
            first = range.end;
            let hierarchy = self.hierarchy.as_mut().map(Arc::make_mut);
            let mesh = match hierarchy.and_then(|h| h.bind_mut(i)) {
                Some(bind) => {
                    bind.targets.iter_mut().for_each(|t| t.tangents.clear());
                    &mut bind.mesh
                }
                None => mesh,
            };
            mesh.positions.copy_from_slice(&positions[range.clone()]);
            mesh.normals.copy_from_slice(&normals[range]);
            mesh.tangents.clear();
        }
        assert!([positions.len(), normals.len()] == [first; 2], "one of each per vertex");
        let pose = self.pose(None, 0.0);
        self.set_pose(pose);
    }
}
