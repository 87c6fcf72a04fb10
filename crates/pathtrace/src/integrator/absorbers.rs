//! Which absorbing solids a path is in: the innermost one absorbs.

use crate::world::World;
use photofit_scalar::Vec3f;

/// Solids within one another that are told apart; further ones are counted alone, so that leaving them changes nothing.
const CAPACITY: usize = 8;

/// The solids around a path, outermost first, each by its material.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Absorbers {
    materials: [u32; CAPACITY],
    len: u32,
    /// Solids further in.
    further: u32,
}

impl Absorbers {
    pub(super) const NONE: Self = Self { materials: [0; CAPACITY], len: 0, further: 0 };

    #[inline(always)]
    pub(super) fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Takes up that the surface of an instance is crossed, inwards or outwards; surfaces that bound no solid change
    /// nothing.
    #[inline(always)]
    pub(super) fn cross(&mut self, world: &World, instance: u32, inwards: bool) {
        let material = world.placed[instance as usize].material;
        if !world.materials[material as usize].solid {
            return;
        }
        let len = self.len as usize % (CAPACITY + 1);
        if inwards {
            match self.materials.get_mut(len) {
                Some(place) => {
                    *place = material;
                    self.len += 1;
                }
                None => self.further += 1,
            }
        } else if self.further > 0 {
            self.further -= 1;
        } else if let Some(at) = self.materials[..len].iter().rposition(|m| *m == material) {
            self.materials.copy_within(at + 1..len, at);
            self.len -= 1;
        }
    }

    /// The material whose absorption [`Self::on_the_way_to`] tells.
    pub(super) fn solid_before(&self, world: &World, instance: u32, front: bool) -> Option<u32> {
        if !front && self.is_empty() {
            let material = world.placed[instance as usize].material;
            return world.materials[material as usize].solid.then_some(material);
        }
        self.innermost()
    }

    /// The material of the innermost solid.
    pub(super) fn innermost(&self) -> Option<u32> {
        let top = self.len.checked_sub(1)?;
        Some(self.materials[top as usize % CAPACITY])
    }

    /// The same for a way of a length; without end it absorbs nothing.
    pub(super) fn innermost_on(&self, length: f32) -> Option<u32> {
        self.innermost().filter(|_| length < f32::INFINITY)
    }

    /// Absorption per unit of length of the innermost solid.
    #[inline(always)]
    pub(super) fn absorption(&self, world: &World) -> Vec3f {
        match self.len.checked_sub(1) {
            Some(top) => world.materials[self.materials[top as usize % CAPACITY] as usize].absorption,
            None => Vec3f::zero(),
        }
    }

    /// Absorption on the way to a surface: that of the innermost solid, or, where none is known and the surface is
    /// reached from inside, that of the solid it bounds (the way began in there).
    #[inline(always)]
    pub(super) fn on_the_way_to(&self, world: &World, instance: u32, front: bool) -> Vec3f {
        if !front && self.is_empty() {
            return world.materials[world.placed[instance as usize].material as usize].absorption;
        }
        self.absorption(world)
    }
}
