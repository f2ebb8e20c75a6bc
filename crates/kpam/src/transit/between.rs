//! Upper bounds on the movement between two configurations. The points of a group move nearly straight between their
//! two positions; lever arms bound the deviation. Quinlan's bubbles bound the approach of two groups.

use super::sweep::{Look, Sweep};
use crate::Trajectory;
use crate::world::TOUCH;

/// Upper bound on the rounding error of positions in single precision (m).
const ROUNDING: f32 = 2e-5;
/// If all joints together rotate by more than this (rad) between two configurations, no bound is computed.
const MOST_TURN: f32 = 0.8;

/// Bounds on the movement of each joint between two checked configurations.
pub(super) struct Travel {
    /// Upper bound on the movement of each joint between the configurations (rad or m).
    pub gone: Vec<f32>,
    /// Distance between each joint's values at the two configurations (rad or m).
    apart: Vec<f32>,
    /// Maximum deviation of each joint from the straight line in joint space (rad or m).
    off: Vec<f32>,
}

impl Sweep<'_> {
    /// Returns bounds on the movement of each joint between two checked configurations.
    pub fn travel(&self, motion: &Trajectory, a: &Look, b: &Look) -> Travel {
        let h = b.time - a.time;
        let hardest = motion.hardest([a.time, b.time]);
        let mut acceleration = vec![0.0; a.q.len()];
        for driven in self.model.map().driven() {
            acceleration[driven.joint] = driven.factor.abs() * hardest[driven.variable];
        }
        let joints = 0..a.q.len();
        let apart = |j: usize| (a.q[j] - b.q[j]).abs();
        Travel {
            // A joint that reverses between the configurations moves no further than its acceleration allows.
            gone: joints.clone().map(|j| apart(j).max(0.5 * acceleration[j] * h * h) as f32).collect(),
            apart: joints.clone().map(|j| apart(j) as f32).collect(),
            off: joints.map(|j| (0.125 * acceleration[j] * h * h) as f32).collect(),
        }
    }

    /// Returns whether the gaps of a pair at both configurations exclude a collision while moving between them.
    pub fn covers(&self, a: &Look, b: &Look, place: usize, groups: usize, travel: &Travel) -> bool {
        if place >= groups {
            return self.used(a, b, place, &travel.gone);
        }
        let (one, two) = (a.gaps[place], b.gaps[place]);
        if !(one > 0.0 && two > 0.0) {
            return false;
        }
        // A point moves a distance c along the straight line between its positions. After a fraction s of the line, the
        // gap is at least one - s c and at least two - (1 - s) c, hence at least the mean of both bounds. The bend is
        // the point's maximum deviation from the straight line.
        let way = furthest(&a.corners[place], &b.corners[place]);
        let (one, two) = (one.max(two - way), two.max(one - way));
        let Some(bend) = self.bend(a, b, place, travel) else { return false };
        0.5 * (one + two - way) >= bend + ROUNDING
    }

    /// Returns the maximum deviation of a point of a group from the straight line between its positions at the same
    /// fraction of the time; `None` if the joints rotate too far for a bound.
    fn bend(&self, a: &Look, b: &Look, group: usize, travel: &Travel) -> Option<f32> {
        let joints = a.q.len();
        let lever = |j: usize| a.levers[group * joints + j].min(b.levers[group * joints + j]);
        // A lever arm grows by at most the displacement of the group, which the lever arms themselves bound.
        let (mut turned, mut slid, mut longest) = (0.0_f32, 0.0_f32, 0.0_f32);
        for &(j, _) in &self.world.carriers[group] {
            let most = travel.gone[j] + travel.off[j];
            if self.slides[j] {
                slid += most;
            } else {
                turned += most;
            }
            longest = longest.max(lever(j));
        }
        if turned > MOST_TURN {
            return None;
        }
        let grown = turned * (longest + slid) / (1.0 - turned) + slid;
        // The second derivative of a point by joints i and k, with i closer to the base, is at most the lever arm of k.
        // A curve with second derivative m deviates from its chord by at most m / 8.
        let (mut bend, mut before) = (0.0, 0.0);
        for &(j, _) in &self.world.carriers[group] {
            let lever = if self.slides[j] { 1.0 } else { lever(j) + grown };
            let own = travel.apart[j];
            bend += lever * (0.125 * own * (own + 2.0 * before) + travel.off[j]);
            before += own;
        }
        Some(bend)
    }

    /// Returns whether the gaps of a pair at both configurations exclude a collision while moving between them. A point
    /// at distance r from a joint's axis moves at most r + d per radian while it stays within d of its position.
    fn used(&self, a: &Look, b: &Look, place: usize, travel: &[f32]) -> bool {
        let (one, two) = (a.gaps[place], b.gaps[place]);
        if !(one > 0.0 && two > 0.0) {
            return false;
        }
        let joints = a.q.len();
        let mut shares = 0.0;
        for (joint, group) in &self.movers[place] {
            let at = group * joints + joint;
            shares += travel[*joint] * ((a.levers[at] + one) / one).max((b.levers[at] + two) / two);
        }
        shares <= 1.999
    }

    /// Returns whether two collision-free configurations are so close that rounding exceeds the movement between them.
    pub fn is_still(&self, a: &Look, b: &Look, place: usize, travel: &[f32]) -> bool {
        if !(a.gaps[place] >= -1e-7 && b.gaps[place] >= -1e-7) {
            return false;
        }
        let joints = a.q.len();
        let mut way = 0.0;
        for (joint, group) in &self.movers[place] {
            let at = group * joints + joint;
            way += travel[*joint] * (a.levers[at].max(b.levers[at]) + 0.01);
        }
        f64::from(way) <= 0.5 * TOUCH
    }
}

/// Returns the maximum distance between corresponding corners of two boxes.
fn furthest(a: &[[f32; 8]; 3], b: &[[f32; 8]; 3]) -> f32 {
    let mut most = [0.0_f32; 8];
    for k in 0..3 {
        for corner in 0..8 {
            let way = a[k][corner] - b[k][corner];
            most[corner] += way * way;
        }
    }
    most.into_iter().fold(0.0, f32::max).sqrt()
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use gensim2_geometry::Robot;
    use nalgebra::Point3;

    use super::*;
    use crate::model::{MAX_JOINTS, Model, Row};
    use crate::timing::{Builder, Limits, Spline};
    use crate::world::Compiled;
    use crate::{Cancel, Scene, TransitOptions};
    use gensim2_geometry::Draws;

    /// An arm with a revolute, a sliding and another revolute joint, and a box on each link.
    fn arm() -> Arc<Robot> {
        let joint = |i: usize, kind: &str, axis: &str, xyz: &str| {
            let (above, reach) = (i - 1, if kind == "prismatic" { 0.2 } else { 2.5 });
            format!(
                r#"<joint name="j{i}" type="{kind}"><parent link="l{above}"/><child link="l{i}"/><origin xyz="{xyz}"/>
                <axis xyz="{axis}"/><limit lower="-{reach}" upper="{reach}" effort="1" velocity="2"/></joint>"#
            )
        };
        let links: String = (0..6)
            .map(|i| {
                format!(
                    r#"<link name="l{i}"><collision><origin xyz="0.02 0.01 0.12"/><geometry>
                    <box size="0.07 0.05 0.25"/></geometry></collision></link>"#
                )
            })
            .collect();
        let joints = [
            joint(1, "revolute", "0 0 1", "0 0 0.3"),
            joint(2, "revolute", "0 1 0", "0.05 0 0.1"),
            joint(3, "prismatic", "0 0 1", "0 0 0.3"),
            joint(4, "revolute", "1 0 0", "0 0 0.2"),
            joint(5, "revolute", "0.6 0.8 0", "0 0.05 0.25"),
        ]
        .concat();
        let text = format!(r#"<robot name="arm">{links}{joints}</robot>"#);
        Arc::new(Robot::from_urdf_str(&text, "arm.urdf", None, "l5", None).unwrap())
    }

    #[test]
    fn no_point_lies_further_off_its_line_than_its_group_bends() {
        let robot = arm();
        let scene = Scene::new(Arc::clone(&robot), Vec::new(), Vec::new()).unwrap();
        let model = Model::new(&robot, &[0.0; 5]).unwrap();
        let limits = Limits::asked(&model, &TransitOptions::default().limits());
        let world = scene.compiled();
        let needs = world.needs(0.0).into();
        let mut draws = Draws::of(1, 2);
        let (mut poses, mut q) = (Vec::new(), Vec::new());
        let mut tightest: f64 = 0.0;
        for _ in 0..8 {
            let waypoints: Vec<Row> = (0..4)
                .map(|_| {
                    let mut x = [0.0; MAX_JOINTS];
                    (0..5).for_each(|v| x[v] = (if v == 2 { 0.3 } else { 2.0 }) * (draws.unit() - 0.5));
                    x
                })
                .collect();
            let mut builder = Builder::new(limits, 0.0);
            builder.push(&Spline::through(5, &waypoints, None), &[], &[0.0; MAX_JOINTS], None, &[]).unwrap();
            let motion = builder.build(model.map());
            let over = Cancel::new();
            let mut sweep = Sweep::new(&scene, &model, &needs, [1.0; MAX_JOINTS], &over);
            for k in 0..40 {
                let h = 0.01 + 0.1 * draws.unit();
                let begin = (motion.end() - h) * f64::from(k) / 39.0;
                let looks = sweep.look(&motion, &[begin, begin + h]).ok().unwrap();
                let travel = sweep.travel(&motion, &looks[0], &looks[1]);
                let mut places = |t: f64| -> Vec<Vec<Point3<f64>>> {
                    model.map().positions(&motion.moving(t), &mut q);
                    Compiled::poses(&scene, &q, &mut poses);
                    let of = |name: &String| {
                        let link = robot.link_index(name).unwrap();
                        robot.links()[link].shapes()[0].points().iter().map(|p| poses[link] * p).collect()
                    };
                    world.names.iter().map(of).collect()
                };
                let (first, last) = (places(begin), places(begin + h));
                for group in 0..world.names.len() {
                    let Some(bend) = sweep.bend(&looks[0], &looks[1], group, &travel) else { continue };
                    let way = f64::from(furthest(&looks[0].corners[group], &looks[1].corners[group]));
                    for step in 1..8 {
                        let share = f64::from(step) / 8.0;
                        let between = places(begin + share * h);
                        for ((a, b), p) in first[group].iter().zip(&last[group]).zip(&between[group]) {
                            let off = (p - (a + (b - a) * share)).norm();
                            assert!(off <= f64::from(bend + ROUNDING), "{off} {bend}");
                            assert!((b - a).norm() <= way + 1e-5);
                            tightest = tightest.max(off / f64::from(bend + ROUNDING));
                        }
                    }
                }
            }
        }
        // The bound is tight: at least one motion comes close to it.
        assert!(tightest > 0.1, "{tightest}");
    }
}
