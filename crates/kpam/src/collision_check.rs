//! Does the robot touch anything? The plain question, for many configurations, without contact rules.

use gensim2_geometry::{RobotShapes, Scene, Scratch};

use crate::KeypointProblem;
use crate::problem::Role;

/// Checks whole configurations of a problem's robot: against all bodies of the scene, and against itself.
pub struct CollisionCheck<'p> {
    problem: &'p KeypointProblem,
    shapes: RobotShapes,
    scene: Scene,
    moving: Vec<bool>,
    scratch: Scratch,
}

impl<'p> CollisionCheck<'p> {
    /// A check for `problem`; attached bodies ride on the hand, the rest stands still.
    #[must_use]
    pub fn new(problem: &'p KeypointProblem) -> Self {
        let robot = &problem.robot;
        let links = robot.links();
        let moving: Vec<bool> = (0..links.len())
            .map(|mut link| {
                loop {
                    if links[link].joint.is_some() {
                        return true;
                    }
                    match links[link].parent {
                        Some(parent) => link = parent,
                        None => return false,
                    }
                }
            })
            .collect();
        let mut shapes = RobotShapes::new(robot, |a, b| moving[a] || moving[b]);
        let (riding, standing): (Vec<_>, Vec<_>) = problem.bodies.iter().partition(|b| b.role == Role::Attached);
        for body in riding {
            let moved: Vec<_> = body.shapes.iter().map(|s| s.moved(&body.pose)).collect();
            shapes.attach(robot.hand(), &moved);
        }
        let scene = Scene::new(standing.iter().map(|b| (b.shapes.as_slice(), &b.pose)));
        Self { problem, shapes, scene, moving, scratch: Scratch::default() }
    }

    /// Whether the robot at the full joint vector `q` overlaps a body or itself. Links that no joint moves, and pairs
    /// that the SRDF disables, are left out.
    #[must_use]
    pub fn hits(&mut self, q: &[f64]) -> bool {
        self.shapes.place(&self.problem.robot, q, &mut self.scratch);
        let reach = |link: usize, _: usize| if self.moving[link] { 0.0 } else { f64::NEG_INFINITY };
        let exact = f64::INFINITY;
        !self.shapes.near_bodies(&self.scene, &mut self.scratch, exact, reach, |_| false)
            || !self.shapes.near_self(&mut self.scratch, exact, |_| 0.0, |_, _| false)
    }
}
