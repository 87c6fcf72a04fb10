//! A scene at a moment of an animation.

mod vertices;

use crate::nodes::{Hierarchy, Lens, NodeTransform, Placement};
use crate::skin::Bind;
use crate::{Camera, Instance, LightPicture, PunctualLight, Scene};
use glam::{Affine3A, Vec3};
use photofit_geometry::Mesh;

/// What a pose changes in a scene.
#[derive(Clone, Debug, Default)]
pub struct Pose {
    /// As many as [`Scene::instances`], in the same order, of the same primitives.
    pub instances: Vec<Instance>,
    /// Deformed primitives: index into [`Scene::primitives`] and geometry, as many vertices and triangles as before.
    pub meshes: Vec<(usize, Mesh)>,
    /// As [`Scene::cameras`].
    pub cameras: Vec<Camera>,
    /// As [`Scene::lights`].
    pub lights: Vec<PunctualLight>,
}

impl Scene {
    /// The scene at `time` seconds of an animation; the default pose for `None`.
    ///
    /// Before the first key and after the last one the values of these keys count. What was added to the scene by hand
    /// (beyond what its nodes place) stays as it is; a scene without [`Scene::hierarchy`] has one pose.
    ///
    /// # Panics
    /// If there is no such animation, the time is not a number, or the scene is not valid (see [`Scene::validate`]).
    pub fn pose(&self, animation: Option<usize>, time: f32) -> Pose {
        assert!(!time.is_nan(), "a time is a number");
        let mut pose = Pose {
            instances: self.instances.clone(),
            meshes: Vec::new(),
            cameras: self.cameras.clone(),
            lights: self.lights.clone(),
        };
        let Some(hierarchy) = self.hierarchy.as_deref() else {
            assert!(animation.is_none(), "the scene has no animations");
            return pose;
        };
        let at = NodesAt::new(hierarchy, animation, time);
        let mut done = vec![false; self.primitives.len()];
        for (instance, placement) in pose.instances.iter_mut().zip(&hierarchy.placements) {
            let (transform, bind) = at.part(placement);
            instance.transform = transform;
            let Some((bind, weights, joints)) = bind else { continue };
            if !std::mem::replace(&mut done[instance.primitive], true) {
                pose.meshes.push((instance.primitive, bind.posed(weights, joints)));
            }
        }
        let (cameras, lights) = hierarchy.cameras_and_lights(&at.world);
        pose.cameras.splice(..cameras.len().min(pose.cameras.len()), cameras);
        pose.lights.splice(..lights.len().min(pose.lights.len()), lights);
        pose
    }

    /// Puts a pose of this scene in the place of the present one. [`crate::to_glb`] writes the default pose with all
    /// animations: to write another pose alone, take [`Scene::hierarchy`] away.
    ///
    /// # Panics
    /// If the pose is one of another scene.
    pub fn set_pose(&mut self, pose: Pose) {
        let same = |(a, b): (&Instance, &Instance)| a.primitive == b.primitive;
        let fits = self.instances.len() == pose.instances.len();
        assert!(fits && self.instances.iter().zip(&pose.instances).all(same), "a pose of this scene");
        self.instances = pose.instances;
        self.cameras = pose.cameras;
        self.lights = pose.lights;
        for (primitive, mesh) in pose.meshes {
            self.primitives[primitive].mesh = mesh;
        }
    }
}

/// A part that is deformed: its bind pose, the weights of its morph targets and the matrices of its joints.
type Deformed<'a> = (&'a Bind, &'a [f32], Option<&'a [Affine3A]>);

/// The nodes of a hierarchy at a moment.
struct NodesAt<'a> {
    hierarchy: &'a Hierarchy,
    /// World transforms.
    world: Vec<Affine3A>,
    /// Matrices of the joints of each skin.
    joints: Vec<Vec<Affine3A>>,
    /// Morph weights of each node.
    weights: Vec<Vec<f32>>,
}

impl<'a> NodesAt<'a> {
    fn new(hierarchy: &'a Hierarchy, animation: Option<usize>, time: f32) -> Self {
        let mut transforms: Vec<NodeTransform> = hierarchy.nodes.iter().map(|n| n.transform).collect();
        let mut weights = hierarchy.weights();
        if let Some(a) = animation {
            hierarchy.animations[a].apply(time, &mut transforms, &mut weights);
        }
        let local: Vec<Affine3A> = transforms.iter().map(NodeTransform::affine).collect();
        let world = hierarchy.worlds(&local);
        let joints = hierarchy.skins.iter().map(|s| s.matrices(&world)).collect();
        Self { hierarchy, world, joints, weights }
    }

    /// Where a part stands, and how it is deformed there.
    fn part(&self, placement: &Placement) -> (Affine3A, Option<Deformed<'_>>) {
        let node = &self.hierarchy.nodes[placement.node];
        let transform = if node.skin.is_some() { Affine3A::IDENTITY } else { self.world[placement.node] };
        let bind = self.hierarchy.bind(placement);
        let joints = node.skin.map(|s| self.joints[s].as_slice());
        (transform, bind.map(|bind| (bind, self.weights[placement.node].as_slice(), joints)))
    }
}

impl Hierarchy {
    /// The bind pose of a part; `None` for rigid ones.
    fn bind(&self, placement: &Placement) -> Option<&Bind> {
        self.meshes[self.nodes[placement.node].mesh?].primitives[placement.part].bind.as_ref()
    }

    /// The bind pose of the part of a placement.
    fn bind_mut(&mut self, placement: usize) -> Option<&mut Bind> {
        let Placement { node, part } = *self.placements.get(placement)?;
        self.meshes[self.nodes[node].mesh?].primitives[part].bind.as_mut()
    }

    /// Morph weights of each node in the default pose.
    pub(crate) fn weights(&self) -> Vec<Vec<f32>> {
        let of_mesh = |mesh: Option<usize>| mesh.map_or_else(Vec::new, |m| self.meshes[m].weights.clone());
        let own = |w: &Vec<f32>| (!w.is_empty()).then(|| w.clone());
        self.nodes.iter().map(|n| own(&n.weights).unwrap_or_else(|| of_mesh(n.mesh))).collect()
    }

    /// The pinhole cameras and the lights that are shown, in world space.
    pub(crate) fn cameras_and_lights(&self, world: &[Affine3A]) -> (Vec<Camera>, Vec<PunctualLight>) {
        let (mut cameras, mut lights) = (Vec::new(), Vec::new());
        for node in self.shown() {
            let place = &world[node];
            cameras.extend(self.nodes[node].camera.and_then(|c| self.cameras[c].lens.placed(place)));
            lights.extend(self.nodes[node].light.map(|l| {
                let light = self.lights[l].light.clone();
                let turned = |d: Vec3, usual| place.transform_vector3(d).try_normalize().unwrap_or(usual);
                PunctualLight {
                    position: place.transform_point3(light.position),
                    direction: turned(light.direction, Vec3::NEG_Z),
                    picture: light.picture.map(|p| LightPicture {
                        u: turned(p.u, Vec3::X),
                        v: turned(p.v, Vec3::Y),
                        ..p
                    }),
                    ..light
                }
            }));
        }
        (cameras, lights)
    }
}

impl Lens {
    /// The camera where its node's world transform puts it; `None` for parallel rays, which [`Camera`] does not have.
    pub fn placed(&self, world: &Affine3A) -> Option<Camera> {
        let Self::Perspective { fov_y, aspect, near, far } = *self else { return None };
        let eye = world.translation.into();
        let forward = world.transform_vector3(Vec3::NEG_Z).try_normalize().unwrap_or(Vec3::NEG_Z);
        let up = world.transform_vector3(Vec3::Y);
        let (aspect, far) = (aspect.unwrap_or(1.0), far.unwrap_or(near * 1e6));
        Some(Camera::look_at(eye, eye + forward, up, fov_y, aspect, near, far))
    }
}
