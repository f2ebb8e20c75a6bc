//! Bounds on the positions that links can take at any joint values.

use nalgebra::{Matrix3, Point3, Vector3};

use crate::{JointKind, Robot};

/// Orientations that a link can take at any joint values.
#[derive(Debug, Clone, Copy)]
enum Orientation {
    Fixed(Matrix3<f64>),
    /// The given orientation, rotated by any angle about a unit axis in the base frame.
    About(Matrix3<f64>, Vector3<f64>),
    Any,
}

/// A sphere in the base frame that contains a link's origin at any joint values, if no prismatic joint exceeds its
/// maximum travel.
#[derive(Debug, Clone, Copy)]
pub(super) struct Region {
    center: Point3<f64>,
    radius: f64,
    orientation: Orientation,
}

impl Region {
    /// Returns the region of every link of a robot. `travel` returns the maximum absolute value (m) of a prismatic
    /// joint.
    pub fn of_links(robot: &Robot, travel: impl Fn(usize) -> f64) -> Vec<Self> {
        let mut out: Vec<Self> = Vec::with_capacity(robot.links().len());
        for link in robot.links() {
            let origin = link.origin();
            let base =
                Self { center: Point3::origin(), radius: 0.0, orientation: Orientation::Fixed(Matrix3::identity()) };
            let mut region = link.parent().map_or(base, |parent| out[parent]);
            if link.parent().is_some() {
                region = region.at(&origin.translation.vector);
                let turned = origin.rotation.matrix();
                region.orientation = match region.orientation {
                    Orientation::Fixed(own) => Orientation::Fixed(own * turned),
                    Orientation::About(own, axis) => Orientation::About(own * turned, axis),
                    Orientation::Any => Orientation::Any,
                };
            }
            if let Some(joint) = link.joint() {
                let axis: Vector3<f64> = *robot.joints()[joint].axis();
                match (robot.joints()[joint].kind(), region.orientation) {
                    (JointKind::Prismatic, _) => region.radius += travel(joint),
                    (JointKind::Revolute, Orientation::Fixed(own)) => {
                        region.orientation = Orientation::About(own, own * axis)
                    }
                    (JointKind::Revolute, _) => region.orientation = Orientation::Any,
                }
            }
            out.push(region);
        }
        out
    }

    /// Returns the region of a point given in the link's frame (m).
    pub fn at(&self, point: &Vector3<f64>) -> Self {
        let mut out = *self;
        match &self.orientation {
            Orientation::Fixed(own) => out.center += own * point,
            Orientation::About(own, axis) => {
                let offset = own * point;
                let along = axis * axis.dot(&offset);
                out.center += along;
                out.radius += (offset - along).norm();
            }
            Orientation::Any => out.radius += point.norm(),
        }
        out
    }

    /// Returns the centre (m, base frame) and the radius (m) of the sphere.
    pub fn ball(&self) -> (Point3<f64>, f64) {
        (self.center, self.radius)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use nalgebra::Rotation3;

    use super::super::{Batch, CULL, LANES, Needs, Other, Reachable, Riders, Screen};
    use super::*;
    use crate::{Convex, Cover, Joint, JointBuilder, JointKind, Link, Pose};

    fn pose(at: [f64; 3], turn: [f64; 3]) -> Pose {
        Pose::from_parts(Vector3::from(at).into(), Rotation3::new(Vector3::from(turn)))
    }

    /// An arm whose second joint slides, with a box on every link.
    fn arm() -> Robot {
        let cuboid = || Convex::cuboid([0.04, 0.06, 0.09], &pose([0.02, 0.01, 0.05], [0.2, 0.0, 0.1])).unwrap();
        let link = |parent: &str, name: &str, at: Pose, joint: JointBuilder| {
            Link::below(parent, name).at(at).moved_by(joint.velocity(1.0)).shape(cuboid())
        };
        let revolute = |name: &str, axis: [f64; 3]| Joint::revolute(name, Vector3::from(axis)).limits(-3.0, 3.0);
        let slide = Joint::prismatic("slide", Vector3::z()).limits(-0.1, 0.25);
        Robot::builder("arm")
            .link(Link::base("base"))
            .link(link("base", "one", pose([0.1, 0.0, 0.3], [0.3, 0.2, 0.1]), revolute("a", [0.0, 0.6, 0.8])))
            .link(link("one", "two", pose([0.05, 0.2, 0.1], [0.0, 1.0, 0.0]), slide))
            .link(link("two", "three", pose([0.0, 0.1, 0.2], [1.0, 0.0, 0.0]), revolute("b", [1.0, 0.0, 0.0])))
            .link(link("three", "four", pose([0.0, 0.05, 0.25], [0.0, 0.0, 1.0]), revolute("c", [0.0, 0.0, 1.0])))
            .build("four")
            .unwrap()
    }

    /// Number `k` of a sequence of configurations that fill the joint ranges of a robot evenly.
    fn configuration(robot: &Robot, k: u32) -> Vec<f64> {
        let shares = [0.618_034, 0.414_214, 0.732_051, 0.236_068];
        let value = |(joint, share): (&Joint, f64)| {
            joint.lower() + (joint.upper() - joint.lower()) * (f64::from(k) * share).fract()
        };
        robot.joints().iter().zip(shares).map(value).collect()
    }

    /// Cubes in a grid around a robot, half of them tilted.
    fn cubes() -> Vec<(Vec<Convex>, Pose)> {
        let place = |k: i32| [f64::from(k % 5 - 2), f64::from(k / 5 % 5 - 2), f64::from(k / 25 - 2)].map(|v| 0.45 * v);
        let cube = Convex::cuboid([0.05; 3], &Pose::identity()).unwrap();
        (0..125).map(|k| (vec![cube.clone()], pose(place(k), [0.3 * f64::from(k % 2), 0.1, 0.0]))).collect()
    }

    fn screen_of(robot: &Robot, bodies: &[(Vec<Convex>, Pose)]) -> Screen {
        let groups: Vec<Riders<'_>> = (0..robot.links().len()).map(|link| Riders { link, held: None }).collect();
        Screen::new(robot, &Cover::of(robot), &groups, Vec::new(), bodies.iter().map(|(s, p)| (s.as_slice(), p)))
    }

    #[test]
    fn links_never_leave_their_regions() {
        let robot = arm();
        let travel = |j: usize| robot.joints()[j].lower().abs().max(robot.joints()[j].upper().abs());
        let regions = Region::of_links(&robot, travel);
        let point = Vector3::new(0.03, -0.07, 0.11);
        let (mut filled, mut poses) = (0.0_f64, Vec::new());
        for k in 0..2000 {
            robot.link_poses(&configuration(&robot, k), &mut poses).unwrap();
            for (link, region) in regions.iter().enumerate() {
                let (center, radius) = region.at(&point).ball();
                let away = (poses[link] * Point3::from(point) - center).norm();
                assert!(away <= radius + 1e-9, "link {link}: {away} > {radius}");
                filled = filled.max(away / radius.max(1e-9));
            }
        }
        assert!(filled > 0.9, "{filled}");
    }

    #[test]
    fn links_never_approach_culled_obstacles() {
        let robot = arm();
        let bodies = cubes();
        let screen = screen_of(&robot, &bodies);
        let beyond = |own: &Reachable| (0..125).filter(|e| !own.indices.contains(e)).collect();
        let culled: Vec<Vec<u32>> = screen.reachable.iter().map(beyond).collect();
        // Links closer to the base reach fewer obstacles.
        let counts: Vec<usize> = culled[1..].iter().map(Vec::len).collect();
        assert!(counts.is_sorted_by(|a, b| a > b) && counts[3] > 10, "{counts:?}");
        let mut poses = Vec::new();
        for k in 0..10_000 {
            robot.link_poses(&configuration(&robot, k), &mut poses).unwrap();
            for (group, obstacles) in culled.iter().enumerate().skip(1) {
                for e in obstacles {
                    let other = Other::Element(*e as usize);
                    assert!(
                        screen.keeps(group, other, &poses, CULL, &mut Vector3::zeros()),
                        "group {group}, obstacle {e}"
                    );
                }
            }
        }
    }

    #[test]
    fn prismatic_joints_beyond_their_travel_find_culled_obstacles() {
        let robot = arm();
        let slide = robot.joints().iter().position(|joint| joint.kind() == JointKind::Prismatic).unwrap();
        let mut poses = Vec::new();
        let mut q = configuration(&robot, 7);
        q[slide] = 5.0;
        robot.link_poses(&q, &mut poses).unwrap();
        let cube = Convex::cuboid([0.05; 3], &Pose::identity()).unwrap();
        let screen = screen_of(&robot, &[(vec![cube], poses[4])]);
        assert!(screen.reachable.iter().all(|own| own.indices.is_empty()));
        let mut batch = Batch::default();
        (0..LANES).for_each(|lane| batch.set(&screen, lane, &q));
        screen.place(&mut batch);
        let needs = Needs { bodies: vec![0.0; screen.groups()], pairs: Vec::new() };
        let mut seen = Vec::new();
        screen.survey(&mut batch, &needs, 0.0, |s| {
            seen.push(s.group);
            true
        });
        assert!(seen.contains(&4), "{seen:?}");
    }
}
