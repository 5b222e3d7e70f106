//! Solids of the cell, as colliders of rapier: table, target, gripper, and the object as a chain of boxes.
//!
//! rapier stores the shapes and answers contact queries. It moves nothing here. The renderer draws the solids.

use catenary_core::GripPose;
use catenary_core::model::Section;
use rapier3d::math::{Pose, Rotation, Vector};
use rapier3d::parry::query;
use rapier3d::prelude::{Collider, ColliderBuilder, ColliderHandle, ColliderSet, SharedShape};

/// Part of the cell that a solid belongs to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Part {
    /// Table.
    Table,
    /// Target.
    Target,
    /// Gripper: hand and fingers.
    Gripper,
    /// Deformable object.
    Object,
}

/// Half extents in m of the table top. Its surface is at the table's height.
const TABLE_HALF_M: [f32; 3] = [0.45, 0.35, 0.02];
/// Middle of the table in x, m.
const TABLE_X_M: f32 = 0.45;
/// Radius of the target in m.
pub const TARGET_RADIUS_M: f32 = 0.025;
/// Place of the target in y, m: beside the plane of motion, behind the object as the camera sees it.
const TARGET_Y_M: f32 = 0.05;
/// Half extents in m of the hand and of a finger.
const HAND_HALF_M: [f32; 3] = [0.03, 0.10, 0.03];
const FINGER_HALF_M: [f32; 3] = [0.009, 0.006, 0.025];
/// Height in m of the hand above the grip.
const HAND_ABOVE_M: f32 = 0.075;

/// Pair of parts that touch or nearly touch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Contact {
    /// First part.
    pub first: Part,
    /// Second part.
    pub second: Part,
    /// Distance in m between the surfaces; negative if they overlap.
    pub distance_m: f64,
    /// Point of the first part nearest to the second, (x, y, z) in m.
    pub at_m: [f64; 3],
}

/// Box or ball, as the renderer needs it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Solid {
    /// Box: eight corners in m. Bits 0, 1 and 2 of the index choose the upper side in x, y and z of the box's frame.
    Cuboid([[f64; 3]; 8]),
    /// Ball.
    Ball {
        /// Centre in m.
        centre_m: [f64; 3],
        /// Radius in m.
        radius_m: f64,
    },
}

/// Solids of the cell at their present places.
pub struct Scene {
    colliders: ColliderSet,
    solids: Vec<(Part, ColliderHandle)>,
    gripper: Vec<(ColliderHandle, Pose)>,
    object: Vec<ColliderHandle>,
    half_height_m: f32,
}

impl Scene {
    /// Makes a scene of a gripper, an object of `pieces` boxes, a table at a height in m if there is one, and a target
    /// at (x, z) in m if there is one.
    pub fn new(table_height_m: Option<f64>, target_m: Option<[f64; 2]>, section: Section, pieces: usize) -> Self {
        let half_height_m = match section {
            Section::Square { side_m } => 0.5 * side_m as f32,
            Section::Round { diameter_m } => 0.5 * diameter_m as f32,
        };
        let mut scene = Self {
            colliders: ColliderSet::new(),
            solids: Vec::new(),
            gripper: Vec::new(),
            object: Vec::new(),
            half_height_m,
        };
        if let Some(height) = table_height_m {
            let [x, y, z] = TABLE_HALF_M;
            let place = Vector::new(TABLE_X_M, 0.0, height as f32 - z);
            scene.add(Part::Table, ColliderBuilder::cuboid(x, y, z).position(Pose::from_translation(place)));
        }
        if let Some([x, z]) = target_m {
            let place = Vector::new(x as f32, TARGET_Y_M, z as f32);
            scene.add(Part::Target, ColliderBuilder::ball(TARGET_RADIUS_M).position(Pose::from_translation(place)));
        }
        let finger_y = half_height_m + FINGER_HALF_M[1];
        let places = [
            (HAND_HALF_M, Vector::new(0.0, 0.0, HAND_ABOVE_M)),
            (FINGER_HALF_M, Vector::new(0.0, finger_y, FINGER_HALF_M[2] - half_height_m)),
            (FINGER_HALF_M, Vector::new(0.0, -finger_y, FINGER_HALF_M[2] - half_height_m)),
        ];
        for ([x, y, z], place) in places {
            let handle = scene.add(Part::Gripper, ColliderBuilder::cuboid(x, y, z));
            scene.gripper.push((handle, Pose::from_translation(place)));
        }
        for _ in 0..pieces {
            let handle = scene.add(Part::Object, ColliderBuilder::cuboid(0.01, half_height_m, half_height_m));
            scene.object.push(handle);
        }
        scene
    }

    fn add(&mut self, part: Part, builder: ColliderBuilder) -> ColliderHandle {
        let handle = self.colliders.insert(builder);
        self.solids.push((part, handle));
        handle
    }

    /// Moves the gripper to the hand's pose and the object to the beam's `nodes` (x, z in m and angle in rad; one more
    /// than pieces).
    pub fn update(&mut self, grip: GripPose, nodes: &[[f64; 3]]) {
        let place = Vector::new(grip.x_m as f32, 0.0, grip.z_m as f32);
        let hand = Pose::from_parts(place, Rotation::from_rotation_y(grip.pitch_rad as f32));
        for (handle, offset) in &self.gripper {
            if let Some(collider) = self.colliders.get_mut(*handle) {
                collider.set_position(hand * *offset);
            }
        }
        let half = self.half_height_m;
        for (handle, ends) in self.object.iter().zip(nodes.windows(2)) {
            let Some(collider) = self.colliders.get_mut(*handle) else { continue };
            let (dx, dz) = (ends[1][0] - ends[0][0], ends[1][1] - ends[0][1]);
            let middle =
                Vector::new((0.5 * (ends[0][0] + ends[1][0])) as f32, 0.0, (0.5 * (ends[0][1] + ends[1][1])) as f32);
            let turned = Rotation::from_rotation_y(-dz.atan2(dx) as f32);
            collider.set_shape(SharedShape::cuboid(0.5 * dx.hypot(dz) as f32, half, half));
            collider.set_position(Pose::from_parts(middle, turned));
        }
    }

    /// Returns the nearest contact of each pair of different parts nearer than `within_m`. Gripper and object are left out,
    /// because they always touch.
    pub fn contacts(&self, within_m: f64) -> Vec<Contact> {
        let mut nearest: Vec<Contact> = Vec::new();
        for (i, (first, a)) in self.solids.iter().enumerate() {
            for (second, b) in &self.solids[i + 1..] {
                // The fingers always touch the object that they hold.
                let held = *first == Part::Gripper && *second == Part::Object;
                if first == second || held {
                    continue;
                }
                if let Some(contact) = self.contact(*first, *a, *second, *b, within_m) {
                    let known = nearest.iter_mut().find(|t| t.first == *first && t.second == *second);
                    match known {
                        Some(t) if t.distance_m <= contact.distance_m => {}
                        Some(t) => *t = contact,
                        None => nearest.push(contact),
                    }
                }
            }
        }
        nearest
    }

    fn contact(
        &self,
        first: Part,
        a: ColliderHandle,
        second: Part,
        b: ColliderHandle,
        within_m: f64,
    ) -> Option<Contact> {
        let (a, b) = (self.colliders.get(a)?, self.colliders.get(b)?);
        let contact = query::contact(a.position(), a.shape(), b.position(), b.shape(), within_m as f32).ok()??;
        let p = contact.point1;
        Some(Contact {
            first,
            second,
            distance_m: f64::from(contact.dist),
            at_m: [f64::from(p.x), f64::from(p.y), f64::from(p.z)],
        })
    }

    /// Returns every solid with its part.
    pub fn solids(&self) -> impl Iterator<Item = (Part, Solid)> + '_ {
        self.solids.iter().filter_map(|(part, handle)| Some((*part, solid(self.colliders.get(*handle)?)?)))
    }
}

fn solid(collider: &Collider) -> Option<Solid> {
    let wide = |v: Vector| [f64::from(v.x), f64::from(v.y), f64::from(v.z)];
    let pose = collider.position();
    if let Some(ball) = collider.shape().as_ball() {
        return Some(Solid::Ball { centre_m: wide(pose.translation), radius_m: f64::from(ball.radius) });
    }
    let half = collider.shape().as_cuboid()?.half_extents;
    let corner = |bits: usize| {
        let sign = |axis: usize| if bits >> axis & 1 == 1 { 1.0 } else { -1.0 };
        let local = Vector::new(sign(0) * half.x, sign(1) * half.y, sign(2) * half.z);
        wide(pose.translation + pose.rotation * local)
    };
    Some(Solid::Cuboid(std::array::from_fn(corner)))
}

#[cfg(test)]
mod tests {
    use super::*;

    const SECTION: Section = Section::Square { side_m: 0.015 };

    fn straight_down(z_m: f64, length_m: f64) -> Vec<[f64; 3]> {
        (0..=10).map(|k| [0.4, z_m - length_m * f64::from(k) / 10.0, -1.57]).collect()
    }

    fn grip(z_m: f64) -> GripPose {
        GripPose { x_m: 0.4, z_m, pitch_rad: 0.0 }
    }

    #[test]
    fn an_object_that_reaches_the_table_touches_it() {
        let mut scene = Scene::new(Some(0.0), None, SECTION, 10);
        scene.update(grip(0.3), &straight_down(0.3, 0.2));
        assert_eq!(scene.contacts(0.0), []);
        scene.update(grip(0.3), &straight_down(0.3, 0.302));
        let contacts = scene.contacts(0.0);
        assert_eq!(contacts.len(), 1, "{contacts:?}");
        assert_eq!((contacts[0].first, contacts[0].second), (Part::Table, Part::Object));
        assert!((contacts[0].distance_m + 0.002).abs() < 2e-4, "{contacts:?}");
    }

    #[test]
    fn the_gripper_moves_with_the_hand() {
        let mut scene = Scene::new(Some(0.0), None, SECTION, 0);
        scene.update(grip(0.004), &[]);
        assert!(scene.contacts(0.0).iter().any(|t| t.second == Part::Gripper), "fingertips reach below the grip");
        scene.update(grip(0.1), &[]);
        assert_eq!(scene.contacts(0.0), []);
        assert_eq!(scene.contacts(0.2).len(), 1);
    }

    #[test]
    fn boxes_lie_where_the_beam_is() {
        let mut scene = Scene::new(None, Some([0.5, 0.15]), SECTION, 1);
        scene.update(grip(0.5), &[[0.4, 0.3, 0.0], [0.4, 0.2, 0.0]]);
        let object = scene.solids().find(|(p, _)| *p == Part::Object).unwrap().1;
        let Solid::Cuboid(corners) = object else { panic!("{object:?}") };
        let z = corners.map(|c| c[2]);
        assert!((z.iter().copied().fold(f64::MAX, f64::min) - 0.2).abs() < 1e-6, "{z:?}");
        assert!((z.iter().copied().fold(f64::MIN, f64::max) - 0.3).abs() < 1e-6, "{z:?}");
        let ball = scene.solids().find(|(p, _)| *p == Part::Target).unwrap().1;
        assert!(matches!(ball, Solid::Ball { centre_m, .. } if (centre_m[0] - 0.5).abs() < 1e-6));
    }
}
