//! Axis-aligned boxes and a static bounding volume hierarchy over the boxes, for the broad phase of collision checks.

use nalgebra::{Point3, Vector3};

/// An axis-aligned box.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Aabb {
    /// Corner with the smallest coordinates.
    pub min: Point3<f64>,
    /// Corner with the largest coordinates.
    pub max: Point3<f64>,
}

impl Aabb {
    /// The empty box, which contains no point.
    pub const EMPTY: Self = Self {
        min: Point3::new(f64::INFINITY, f64::INFINITY, f64::INFINITY),
        max: Point3::new(f64::NEG_INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY),
    };

    /// Returns the smallest box around points, enlarged by `radius` on every side.
    #[must_use]
    pub fn around(points: &[Point3<f64>], radius: f64) -> Self {
        let tight = points.iter().fold(Self::EMPTY, |b, p| Self { min: b.min.inf(p), max: b.max.sup(p) });
        tight.grown(radius)
    }

    /// Returns the smallest box around a sphere.
    #[must_use]
    pub fn of_ball(center: &Point3<f64>, radius: f64) -> Self {
        let r = Vector3::repeat(radius);
        Self { min: center - r, max: center + r }
    }

    /// Returns the box enlarged by `by` on every side.
    #[must_use]
    pub fn grown(&self, by: f64) -> Self {
        let r = Vector3::repeat(by);
        Self { min: self.min - r, max: self.max + r }
    }

    /// Returns the smallest box around both boxes.
    #[must_use]
    pub fn union(&self, other: &Self) -> Self {
        Self { min: self.min.inf(&other.min), max: self.max.sup(&other.max) }
    }

    /// Returns whether the boxes share a point.
    #[must_use]
    pub fn overlaps(&self, other: &Self) -> bool {
        self.min.x <= other.max.x
            && other.min.x <= self.max.x
            && self.min.y <= other.max.y
            && other.min.y <= self.max.y
            && self.min.z <= other.max.z
            && other.min.z <= self.max.z
    }

    /// Returns the squared distance between the boxes, 0 if they overlap.
    #[must_use]
    pub fn distance_squared(&self, other: &Self) -> f64 {
        let gap = |a: f64, b: f64, c: f64, d: f64| (c - b).max(a - d).max(0.0);
        let x = gap(self.min.x, self.max.x, other.min.x, other.max.x);
        let y = gap(self.min.y, self.max.y, other.min.y, other.max.y);
        let z = gap(self.min.z, self.max.z, other.min.z, other.max.z);
        x * x + y * y + z * z
    }

    /// Returns whether the line through `origin` along `direction` crosses the box.
    #[must_use]
    pub fn is_crossed_by(&self, origin: &Point3<f64>, direction: &Vector3<f64>) -> bool {
        let (mut enter, mut exit) = (f64::NEG_INFINITY, f64::INFINITY);
        for k in 0..3 {
            let (low, high) = (self.min[k] - origin[k], self.max[k] - origin[k]);
            if direction[k] == 0.0 {
                if low > 0.0 || high < 0.0 {
                    return false;
                }
            } else {
                let (a, b) = (low / direction[k], high / direction[k]);
                enter = enter.max(a.min(b));
                exit = exit.min(a.max(b));
            }
        }
        // Without the tolerance, rounding could make a line that lies in a face of the box miss the box.
        enter <= exit + 1e-9
    }
}

/// Maximum number of boxes in a leaf: testing a few boxes is cheaper than another level of the tree.
const LEAF: usize = 4;

#[derive(Debug, Clone)]
struct Node {
    bounds: Aabb,
    /// Index of the right child (the left one follows its parent), or 0 in a leaf.
    right: u32,
    start: u32,
    end: u32,
}

/// A static tree over axis-aligned boxes, built once.
#[derive(Debug, Clone, Default)]
pub struct Bvh {
    nodes: Vec<Node>,
    order: Vec<u32>,
}

impl Bvh {
    /// Builds the tree. Each node is split at the median along the longest side of the box around the centres.
    #[must_use]
    pub fn new(boxes: &[Aabb]) -> Self {
        let mut tree = Self { nodes: Vec::new(), order: (0..boxes.len() as u32).collect() };
        if !boxes.is_empty() {
            tree.build(boxes, 0, boxes.len());
        }
        tree
    }

    fn build(&mut self, boxes: &[Aabb], start: usize, end: usize) -> u32 {
        let index = self.nodes.len() as u32;
        let of = |i: &u32| boxes[*i as usize];
        let bounds = self.order[start..end].iter().map(of).fold(Aabb::EMPTY, |a, b| a.union(&b));
        self.nodes.push(Node { bounds, right: 0, start: start as u32, end: end as u32 });
        if end - start <= LEAF {
            return index;
        }
        let center = |b: Aabb| nalgebra::center(&b.min, &b.max);
        let span = self.order[start..end]
            .iter()
            .map(|i| center(of(i)))
            .fold(Aabb::EMPTY, |a, c| a.union(&Aabb { min: c, max: c }));
        let axis = (span.max - span.min).imax();
        let middle = (start + end) / 2;
        // The index breaks ties, so that equal centres always split in the same way.
        self.order[start..end].select_nth_unstable_by(middle - start, |a, b| {
            center(of(a))[axis].total_cmp(&center(of(b))[axis]).then(a.cmp(b))
        });
        self.build(boxes, start, middle);
        let right = self.build(boxes, middle, end);
        self.nodes[index as usize].right = right;
        index
    }

    /// Calls `visit` with the index of every box whose leaf lies within `reach` of `query`.
    pub fn near(&self, query: &Aabb, reach: f64, visit: impl FnMut(usize)) {
        let limit = reach * reach;
        self.walk(|bounds| bounds.distance_squared(query) <= limit, visit);
    }

    /// Calls `visit` with the index of every box whose leaf the line through `origin` along `direction` crosses.
    pub fn along(&self, origin: &Point3<f64>, direction: &Vector3<f64>, visit: impl FnMut(usize)) {
        self.walk(|bounds| bounds.is_crossed_by(origin, direction), visit);
    }

    fn walk(&self, enters: impl Fn(&Aabb) -> bool, mut visit: impl FnMut(usize)) {
        if self.nodes.is_empty() {
            return;
        }
        let mut stack = [0u32; 64];
        let mut top = 1;
        while top > 0 {
            top -= 1;
            let at = stack[top];
            let node = &self.nodes[at as usize];
            if !enters(&node.bounds) {
                continue;
            }
            if node.right == 0 {
                for i in &self.order[node.start as usize..node.end as usize] {
                    visit(*i as usize);
                }
            } else {
                // Median splits halve the boxes, so the depth is below 32 for any u32 count, and two pushes always fit.
                stack[top] = node.right;
                stack[top + 1] = at + 1;
                top += 2;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn finds_all_that_is_near(
            corners in prop::collection::vec((prop::array::uniform3(-1.0..1.0f64), prop::array::uniform3(0.0..0.3f64)), 0..60),
            query in prop::array::uniform3(-1.0..1.0f64),
            reach in 0.0..0.5f64,
        ) {
            let boxes: Vec<Aabb> = corners
                .iter()
                .map(|(c, s)| Aabb { min: Point3::from(*c), max: Point3::from(*c) + Vector3::from(*s) })
                .collect();
            let q = Aabb::of_ball(&Point3::from(query), 0.05);
            let mut found = vec![0; boxes.len()];
            Bvh::new(&boxes).near(&q, reach, |i| found[i] += 1);
            for (b, n) in boxes.iter().zip(found) {
                prop_assert!(n <= 1);
                prop_assert!(n == 1 || b.distance_squared(&q) > reach * reach);
            }
        }

        #[test]
        fn finds_all_that_a_line_crosses(
            corners in prop::collection::vec((prop::array::uniform3(-1.0..1.0f64), prop::array::uniform3(0.0..0.3f64)), 0..60),
            origin in prop::array::uniform3(-1.0..1.0f64),
            direction in prop::array::uniform3(-1i32..2),
        ) {
            let direction = Vector3::from(direction).cast::<f64>();
            let origin = Point3::from(origin);
            let boxes: Vec<Aabb> = corners
                .iter()
                .map(|(c, s)| Aabb { min: Point3::from(*c), max: Point3::from(*c) + Vector3::from(*s) })
                .collect();
            let mut found = vec![false; boxes.len()];
            Bvh::new(&boxes).along(&origin, &direction, |i| found[i] = true);
            for (b, found) in boxes.iter().zip(found) {
                let inside = |s: f64| b.distance_squared(&Aabb::of_ball(&(origin + direction * s), 0.0)) == 0.0;
                let crossed = (-400..=400).any(|k| inside(f64::from(k) * 0.01));
                prop_assert!(found || !crossed);
            }
        }
    }
}
