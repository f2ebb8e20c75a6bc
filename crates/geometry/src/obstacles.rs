//! Fixed bodies, stored in a bounding volume hierarchy.

use nalgebra::Point3;

use crate::{Aabb, Bvh, Convex, Corners, Pose};

pub(crate) struct Element {
    pub corners: Corners,
    pub radius: f64,
    pub center: Point3<f64>,
    pub bounds: Aabb,
    pub body: usize,
}

/// Fixed bodies in the base frame, stored in a bounding volume hierarchy.
#[derive(Default)]
pub struct Obstacles {
    pub(crate) elements: Vec<Element>,
    pub(crate) tree: Bvh,
    bodies: usize,
}

impl Obstacles {
    /// Creates obstacles from bodies. Each has its shapes in the body frame, and a pose in the base frame. A body
    /// without shapes keeps its index.
    #[must_use]
    pub fn new<'a>(bodies: impl IntoIterator<Item = (&'a [Convex], &'a Pose)>) -> Self {
        let mut out = Self::default();
        for (index, (shapes, pose)) in bodies.into_iter().enumerate() {
            out.bodies = index + 1;
            out.elements.extend(shapes.iter().map(|s| {
                let shape = s.moved(pose);
                Element {
                    bounds: shape.aabb_at(&Pose::identity()),
                    corners: Corners::of(shape.points()),
                    radius: shape.radius(),
                    center: *shape.center(),
                    body: index,
                }
            }));
        }
        let boxes: Vec<Aabb> = out.elements.iter().map(|e| e.bounds).collect();
        out.tree = Bvh::new(&boxes);
        out
    }

    /// Number of bodies.
    #[must_use]
    pub fn len(&self) -> usize {
        self.bodies
    }

    /// Whether there are no bodies.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.bodies == 0
    }
}
