//! The vertices of a scene's bind pose: how those of a pose follow from them, and other ones in their place.

use super::NodesAt;
use crate::Scene;
use photofit_geometry::skinning::{Affine, Deformation};
use photofit_scalar::Vec3f;
use std::sync::Arc;

impl Scene {
    /// What a moment (see [`Scene::pose`]) does to the vertices of [`Scene::flatten`]: from the bind pose of each, in the
    /// frame of its primitive, to the world.
    ///
    /// # Panics
    /// As [`Scene::pose`].
    pub fn deformation(&self, animation: Option<usize>, time: f32) -> Deformation {
        assert!(!time.is_nan(), "a time is a number");
        let hierarchy = self.hierarchy.as_deref();
        assert!(animation.is_none() || hierarchy.is_some(), "the scene has no animations");
        let at = hierarchy.map(|h| NodesAt::new(h, animation, time));
        let mut all = Deformation::default();
        for (i, instance) in self.instances.iter().enumerate() {
            let count = self.primitives[instance.primitive].mesh.positions.len();
            let placement = hierarchy.and_then(|h| h.placements.get(i));
            let part = at.as_ref().zip(placement).map(|(at, placement)| at.part(placement));
            let (transform, bind) = part.unwrap_or((instance.transform, None));
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
        all
    }

    /// Whether [`Scene::set_bind_vertices`] can change the vertices of the bind pose; else why not.
    ///
    /// # Errors
    /// The rule that is broken: a primitive that is placed more than once, or has no normals in its bind pose.
    pub fn check_bind_vertices(&self) -> Result<(), String> {
        let mut placed = vec![0_usize; self.primitives.len()];
        for (i, instance) in self.instances.iter().enumerate() {
            let primitive = instance.primitive;
            placed[primitive] += 1;
            if placed[primitive] > 1 {
                return Err(format!("primitive {primitive} is placed more than once"));
            }
            let hierarchy = self.hierarchy.as_deref();
            let bind = hierarchy.and_then(|h| h.placements.get(i).and_then(|p| h.bind(p)));
            let mesh = bind.map_or(&self.primitives[primitive].mesh, |bind| &bind.mesh);
            if mesh.normals.len() != mesh.positions.len() {
                return Err(format!("primitive {primitive} has no normals"));
            }
        }
        Ok(())
    }

    /// Puts positions and unit normals, one of each per vertex of [`Scene::flatten`], in place of those of the bind pose, each
    /// in the frame of its primitive. Tangents of the old ones are dropped; the scene stands in its default pose then.
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
                Some(bind) => &mut bind.mesh,
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
