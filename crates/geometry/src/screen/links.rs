//! Data precomputed from the shapes of a robot's links. They do not depend on the surroundings.

use std::sync::Arc;

use nalgebra::Point3;

use super::cover::{Ball, ball_around, cover};
use super::exact::Piece;
use crate::{JointKind, Robot};

/// Data precomputed from the shapes of a robot's links. They do not depend on the surroundings.
#[derive(Debug, Clone, Default)]
pub struct Cover {
    /// Spheres that contain each link's shapes, in the link's frame.
    pub(super) balls: Vec<Vec<Ball>>,
    /// A sphere around all spheres of each link; `None` for a link without shapes.
    pub(super) around: Vec<Option<Ball>>,
    pub(super) pieces: Vec<Arc<[Piece]>>,
    levers: Vec<f64>,
}

/// Number of configurations over which lever arms are averaged.
const LOOKS: u32 = 64;

impl Cover {
    /// Computes the spheres of every link.
    #[must_use]
    pub fn of(robot: &Robot) -> Self {
        let links = robot.links();
        let balls: Vec<Vec<Ball>> = links.iter().map(|link| link.shapes().iter().flat_map(cover).collect()).collect();
        let pieces = links.iter().map(|link| link.shapes().iter().cloned().map(Piece::of).collect()).collect();
        let levers = mean_levers(robot, &balls);
        let around = balls.iter().map(|own| around(own)).collect();
        Self { balls, around, pieces, levers }
    }

    /// Mean lever arm of each joint (m): the maximum distance of any point of the robot from the joint's axis, averaged
    /// over configurations; 1 for a sliding joint.
    #[must_use]
    pub fn levers(&self) -> &[f64] {
        &self.levers
    }
}

fn mean_levers(robot: &Robot, balls: &[Vec<Ball>]) -> Vec<f64> {
    let (joints, links) = (robot.joints(), robot.links());
    let mut sums = vec![0.0; joints.len()];
    let mut poses = Vec::new();
    let mut counter = 0_u32;
    for _ in 0..LOOKS {
        let mut q: Vec<f64> = joints
            .iter()
            .map(|joint| {
                // Multiples of the golden ratio spread the configurations evenly.
                counter += 1;
                let share = (f64::from(counter) * 0.618_033_988_749_894_9).fract();
                let (low, high) = (joint.lower().max(-3.2), joint.upper().min(3.2));
                low + (high - low) * share
            })
            .collect();
        robot.apply_mimic(&mut q);
        if robot.link_poses(&q, &mut poses).is_err() {
            continue;
        }
        for (moved, joint) in (0..links.len()).filter_map(|l| Some((l, links[l].joint()?))) {
            if joints[joint].kind() == JointKind::Prismatic {
                sums[joint] += 1.0;
                continue;
            }
            let (origin, axis) = (poses[moved].translation.vector, poses[moved].rotation * joints[joint].axis());
            let mut furthest: f64 = 0.0;
            for l in (0..links.len()).filter(|l| hangs_on(robot, *l, moved)) {
                for ball in &balls[l] {
                    let arm = (poses[l] * ball.center).coords - origin;
                    furthest = furthest.max((arm - axis * arm.dot(&axis)).norm() + ball.radius);
                }
            }
            sums[joint] += furthest;
        }
    }
    // Joints that move no shape get a small lever arm instead of zero.
    sums.iter().map(|s| (s / f64::from(LOOKS)).max(0.01)).collect()
}

fn hangs_on(robot: &Robot, mut link: usize, top: usize) -> bool {
    while link != top {
        match robot.links()[link].parent() {
            Some(parent) => link = parent,
            None => return false,
        }
    }
    true
}

/// Returns a sphere around spheres; `None` for an empty list.
pub(super) fn around(balls: &[Ball]) -> Option<Ball> {
    let centers: Vec<Point3<f64>> = balls.iter().map(|b| b.center).collect();
    if centers.is_empty() {
        return None;
    }
    let center = ball_around(&centers, 0.0).center;
    let radius = balls.iter().map(|b| (b.center - center).norm() + b.radius).fold(0.0, f64::max);
    Some(Ball { center, radius, inner: f64::NEG_INFINITY })
}
