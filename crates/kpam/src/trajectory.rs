//! Timed joint motion: a twice differentiable curve through each segment's waypoints, driven from rest to rest by a
//! quintic time law, so that velocity, acceleration and jerk are bounded and the ends of segments are met exactly.

use serde::{Deserialize, Serialize};

use crate::curve::{Curve, Limits};
use crate::model::{JointMap, MOST_JOINTS, Row};

/// The time law s(t) on 0..1 with its first three derivatives: rest to rest, smooth in acceleration.
fn quintic(t: f64) -> [f64; 4] {
    let t = t.clamp(0.0, 1.0);
    let (t2, t3) = (t * t, t * t * t);
    [
        t3 * (10.0 - 15.0 * t + 6.0 * t2),
        30.0 * t2 * (1.0 - 2.0 * t + t2),
        60.0 * t * (1.0 - 3.0 * t + 2.0 * t2),
        60.0 * (1.0 - 6.0 * t + 6.0 * t2),
    ]
}

/// The time at which the law is at `s`.
fn time_of(s: f64) -> f64 {
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..8 {
        let middle = 0.5 * (low + high);
        if quintic(middle)[0] < s {
            low = middle;
        } else {
            high = middle;
        }
    }
    let mut t = 0.5 * (low + high);
    for _ in 0..4 {
        let [value, slope, ..] = quintic(t);
        t = (t - (value - s) / slope).clamp(low, high);
    }
    t
}

/// Part of a trajectory.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
enum Law {
    /// Along a curve, from rest to rest.
    Move(Curve),
    /// Straight on from `position` with `velocity` until it has died down.
    Brake { position: Vec<f64>, velocity: Vec<f64> },
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Segment {
    start: f64,
    duration: f64,
    law: Law,
}

/// A timed joint motion of all joints of the robot.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Trajectory {
    segments: Vec<Segment>,
    joints: JointMap,
    times: Vec<f64>,
}

/// Position, velocity and acceleration at one time, each one entry a joint.
#[derive(Debug, Clone, PartialEq)]
pub struct Sample {
    /// rad or m.
    pub position: Vec<f64>,
    /// rad/s or m/s.
    pub velocity: Vec<f64>,
    /// rad/s^2 or m/s^2.
    pub acceleration: Vec<f64>,
}

/// Waypoints of a trajectory are at most this far apart (s), or a `MOST_WAYPOINTS`th of a long motion.
const WAYPOINT_STEP: f64 = 0.1;
/// Beside the ends of segments there are no more waypoints than this, however slow the motion.
const MOST_WAYPOINTS: f64 = 100_000.0;

/// What a trajectory is built from.
pub(crate) struct Builder {
    n: usize,
    limits: Limits,
    segments: Vec<Segment>,
    now: f64,
}

impl Builder {
    pub fn new(n: usize, limits: Limits, start: f64) -> Self {
        Self { n, limits, segments: Vec::new(), now: start }
    }

    /// Time so far (s).
    pub fn now(&self) -> f64 {
        self.now
    }

    /// Brings a motion under way to rest; returns where.
    pub fn brake(&mut self, x: &Row, velocity: &Row) -> Row {
        // v(t) = v0 (1 - s(t)): acceleration peaks at 15/8 v0/T, jerk at 5.774 v0/T^2.
        let mut duration: f64 = 0.0;
        for v in 0..self.n {
            let speed = velocity[v].abs();
            duration = duration
                .max(1.875 * speed / self.limits.acceleration[v])
                .max((5.774 * speed / self.limits.jerk[v]).sqrt());
        }
        let mut end = *x;
        if duration > 0.0 {
            for v in 0..self.n {
                end[v] += 0.5 * velocity[v] * duration;
            }
            let law = Law::Brake { position: x[..self.n].to_vec(), velocity: velocity[..self.n].to_vec() };
            self.segments.push(Segment { start: self.now, duration, law });
            self.now += duration;
        }
        end
    }

    /// Least time (s) in which the limits let a curve be driven.
    fn least_time(&self, curve: &Curve) -> f64 {
        const EVEN: usize = 64;
        const PARTS: usize = 4;
        // Greatest shares of the limits on velocity, acceleration and jerk that the motion in one second takes.
        let mut shares = [0.0_f64; 3];
        let mut look = |t: f64, i: usize| {
            let [s, s1, s2, s3] = quintic(t);
            let place = curve.place(i, s);
            for v in 0..self.n {
                let [_, q1, q2, q3] = curve.joint(v, &place);
                let velocity = (q1 * s1).abs();
                let acceleration = (q2 * s1 * s1 + q1 * s2).abs();
                let jerk = (q3 * s1 * s1 * s1 + 3.0 * q2 * s1 * s2 + q1 * s3).abs();
                shares[0] = shares[0].max(velocity / self.limits.velocity[v]);
                shares[1] = shares[1].max(acceleration / self.limits.acceleration[v]);
                shares[2] = shares[2].max(jerk / self.limits.jerk[v]);
            }
        };
        // Even steps of time for the peaks of the time law, parts of every interval for those of the curve, whose
        // third derivative jumps at its knots.
        for k in 0..=EVEN {
            let t = k as f64 / EVEN as f64;
            look(t, curve.interval(quintic(t)[0]));
        }
        for (i, ends) in curve.knots.windows(2).enumerate() {
            for k in 0..=PARTS {
                let s = ends[0] + (ends[1] - ends[0]) * k as f64 / PARTS as f64;
                look(time_of(s), i);
            }
        }
        // Between those a peak may be missed by a little.
        1.02 * shares[0].max(shares[1].sqrt()).max(shares[2].cbrt())
    }

    /// Appends a motion through waypoints; ends at `end` where that is given, as soon as the limits allow otherwise.
    /// Fails with the least time where `end` comes too early.
    pub fn push(&mut self, waypoints: &[Row], end: Option<f64>) -> Result<(), f64> {
        let curve = Curve::new(self.n, waypoints, &self.limits);
        let least = self.least_time(&curve);
        let duration = match end {
            Some(end) if end - self.now < least => return Err(least),
            Some(end) => end - self.now,
            None => least.max(1e-3),
        };
        self.segments.push(Segment { start: self.now, duration, law: Law::Move(curve) });
        self.now += duration;
        Ok(())
    }

    /// The trajectory of all joints that the variables drive.
    pub fn build(self, joints: &JointMap) -> Trajectory {
        let mut times = Vec::new();
        let total: f64 = self.segments.iter().map(|s| s.duration).sum();
        let step = WAYPOINT_STEP.max(total / MOST_WAYPOINTS);
        for s in &self.segments {
            let steps = ((s.duration / step).ceil() as usize).max(1);
            times.extend((0..steps).map(|k| s.start + s.duration * k as f64 / steps as f64));
        }
        times.push(self.now);
        Trajectory { segments: self.segments, joints: joints.clone(), times }
    }
}

impl Trajectory {
    /// Waypoint times (s); every keyframe time is among them.
    #[must_use]
    pub fn times(&self) -> &[f64] {
        &self.times
    }

    /// Time of the first waypoint (s).
    #[must_use]
    pub fn start(&self) -> f64 {
        self.times[0]
    }

    /// Time of the last waypoint (s).
    #[must_use]
    pub fn end(&self) -> f64 {
        self.times[self.times.len() - 1]
    }

    /// Position, velocity and acceleration of all joints at time `t` (s); before the start and after the end it rests.
    #[must_use]
    pub fn sample(&self, t: f64) -> Sample {
        let [position, velocity, acceleration] = self.moving_with_rates(t);
        let mut out = Sample { position: Vec::new(), velocity: Vec::new(), acceleration: Vec::new() };
        self.joints.positions(&position, &mut out.position);
        self.joints.rates(&velocity, &mut out.velocity);
        self.joints.rates(&acceleration, &mut out.acceleration);
        out
    }

    /// The variables at a time, with their velocities and accelerations.
    fn moving_with_rates(&self, t: f64) -> [Row; 3] {
        let mut out = [self.joints.pick(self.joints.rest()), [0.0; MOST_JOINTS], [0.0; MOST_JOINTS]];
        let n = self.joints.indices().len();
        let at = self.segments.partition_point(|s| s.start <= t).saturating_sub(1);
        let Some(segment) = self.segments.get(at) else { return out };
        let duration = segment.duration;
        let local = ((t - segment.start) / duration).clamp(0.0, 1.0);
        match &segment.law {
            Law::Move(curve) => {
                let [s, s1, s2, _] = quintic(local);
                let place = curve.place(curve.interval(s), s);
                for v in 0..n {
                    let [q, q1, q2, _] = curve.joint(v, &place);
                    out[0][v] = q;
                    out[1][v] = q1 * s1 / duration;
                    out[2][v] = (q2 * s1 * s1 + q1 * s2) / (duration * duration);
                }
            }
            Law::Brake { position, velocity } => {
                let [s, s1, _, _] = quintic(local);
                let t = local;
                let gone = t - (2.5 * t.powi(4) - 3.0 * t.powi(5) + t.powi(6));
                for v in 0..n {
                    out[0][v] = position[v] + velocity[v] * duration * gone;
                    out[1][v] = velocity[v] * (1.0 - s);
                    out[2][v] = -velocity[v] * s1 / duration;
                }
            }
        }
        out
    }

    /// Joint positions at the waypoint times.
    #[must_use]
    pub fn positions(&self) -> Vec<Vec<f64>> {
        self.times.iter().map(|t| self.sample(*t).position).collect()
    }

    /// The moving joints at a time, for checks.
    pub(crate) fn moving(&self, t: f64) -> Row {
        self.moving_with_rates(t)[0]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn limits() -> Limits {
        Limits { velocity: [1.0; MOST_JOINTS], acceleration: [2.0; MOST_JOINTS], jerk: [20.0; MOST_JOINTS] }
    }

    /// Three sliding joints of which the outer two move a hand.
    fn slider() -> JointMap {
        let joint = |i: usize, parent: &str, link: &str| {
            format!(
                r#"<joint name="j{i}" type="prismatic"><parent link="{parent}"/><child link="{link}"/><axis xyz="1 0 0"/>
                <limit lower="-9" upper="9" effort="1" velocity="1"/></joint>"#
            )
        };
        let joints = [joint(0, "base", "a"), joint(1, "base", "b"), joint(2, "a", "hand")].concat();
        let links = ["base", "a", "b", "hand"].map(|name| format!(r#"<link name="{name}"/>"#)).concat();
        let text = format!(r#"<robot name="slider">{links}{joints}</robot>"#);
        let robot = gensim2_geometry::Robot::from_urdf_str(&text, "slider.urdf", None, "hand", None).unwrap();
        crate::model::Model::new(&robot, &[0.0, 7.0, 0.0]).unwrap().map().clone()
    }

    fn row(a: f64, b: f64) -> Row {
        let mut out = [0.0; MOST_JOINTS];
        (out[0], out[1]) = (a, b);
        out
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(40))]
        #[test]
        fn limits_hold_and_waypoints_are_met(
            points in prop::collection::vec((-2.0..2.0f64, -2.0..2.0f64), 2..7),
            v0 in -0.9..0.9f64,
        ) {
            let mut builder = Builder::new(2, limits(), 0.0);
            let begin = row(points[0].0, points[0].1);
            let rest = builder.brake(&begin, &row(v0, -0.5 * v0));
            let mut way: Vec<Row> = vec![rest];
            way.extend(points.iter().skip(1).map(|(a, b)| row(*a, *b)));
            prop_assert!(builder.push(&way, None).is_ok());
            let trajectory = builder.build(&slider());
            prop_assert!((trajectory.sample(0.0).velocity[0] - v0).abs() < 1e-12);
            let end = trajectory.sample(trajectory.end()).position;
            let last = points[points.len() - 1];
            prop_assert!((end[0] - last.0).abs() < 1e-9 && (end[2] - last.1).abs() < 1e-9 && end[1] == 7.0);
            let h = trajectory.end() / 3000.0;
            let mut previous = trajectory.sample(0.0);
            for k in 1..=3000 {
                let now = trajectory.sample(h * f64::from(k));
                for j in [0, 2] {
                    prop_assert!(now.velocity[j].abs() <= 1.0 + 1e-6);
                    prop_assert!(now.acceleration[j].abs() <= 2.0 + 1e-6);
                    // Derivatives are those of the positions.
                    let slope = (now.position[j] - previous.position[j]) / h;
                    let between = 0.5 * (now.velocity[j] + previous.velocity[j]);
                    prop_assert!((slope - between).abs() < 20.0 * h * h + 1e-9, "{slope} {between}");
                    prop_assert!((now.acceleration[j] - previous.acceleration[j]).abs() <= 20.0 * 1.02 * h + 1e-9);
                }
                previous = now;
            }
        }
    }

    #[test]
    fn a_clock_too_fast_is_refused() {
        let mut builder = Builder::new(2, limits(), 0.0);
        let way = [row(0.0, 0.0), row(1.0, 0.0)];
        let least = builder.push(&way, Some(0.5)).unwrap_err();
        assert!(least > 1.8 && builder.push(&way, Some(least)).is_ok());
    }

    #[test]
    fn a_sharp_bend_is_slow_only_there() {
        let time = |bend: f64| {
            let franka =
                Limits { velocity: [2.0; MOST_JOINTS], acceleration: [10.0; MOST_JOINTS], jerk: [5000.0; MOST_JOINTS] };
            let mut builder = Builder::new(2, franka, 0.0);
            let leg = |k: i32| f64::from(k) * 0.005;
            let mut way: Vec<Row> = (0..=200).map(|k| row(leg(k), 0.0)).collect();
            way.extend((1..=200).map(|k| row(1.0 + leg(k) * bend.cos(), leg(k) * bend.sin())));
            assert!(builder.push(&way, None).is_ok());
            builder.now()
        };
        let (straight, bent) = (time(0.0), time(1.5));
        // Two legs from rest to rest take less than twice as long as both in one go.
        assert!(straight < bent && bent < 2.0 * straight, "{straight} {bent}");
    }
}
