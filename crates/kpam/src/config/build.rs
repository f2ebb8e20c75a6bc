//! Creates configs in code, and validates every config.

use std::ops::RangeInclusive;

use nalgebra::Vector3;

use super::{Constraint, Frame, Gripper, Motion, SolverConfig, TargetAxis};
use crate::ConfigError;

/// Maximum number of entries in a list; a longer list counts as damaged input.
pub(super) const MAX_ENTRIES: usize = 200;
/// Maximum absolute value of any number. The metres, radians and seconds of a table-top scene are far smaller.
pub(super) const LARGEST: f64 = 1e6;
/// Permitted distances (m) of the hand's retreat after the release.
const BACK: RangeInclusive<f64> = 0.01..=0.3;
/// Permitted deviation of a direction's length from 1.
const UNIT: f64 = 1e-6;

type Result<T> = std::result::Result<T, ConfigError>;

/// Builds a [`SolverConfig`] from constraints and motions; [`SolverConfigBuilder::build`] validates it.
#[derive(Debug, Clone)]
#[must_use]
pub struct SolverConfigBuilder(SolverConfig);

impl SolverConfigBuilder {
    pub(super) fn new() -> Self {
        Self(SolverConfig {
            constraints: Vec::new(),
            pre: Vec::new(),
            post: Vec::new(),
            actuation_time: None,
            pre_times: None,
            post_times: None,
            gripper: Gripper::Open,
            let_go: None,
            source: String::new(),
        })
    }

    /// Adds a constraint or a cost of the actuation pose.
    pub fn constraint(mut self, constraint: Constraint) -> Self {
        self.0.constraints.push(constraint);
        self
    }

    /// Adds a motion before the actuation pose. The first one added is directly before the pose, and executed last.
    pub fn pre(mut self, motion: Motion) -> Self {
        self.0.pre.push(motion);
        self
    }

    /// Adds a motion after the actuation pose; motions are executed in the order in which they are added.
    pub fn post(mut self, motion: Motion) -> Self {
        self.0.post.push(motion);
        self
    }

    /// Sets the times (s) of the actuation pose and of the keyframes before and after it, each list in time order.
    pub fn times(mut self, actuation: f64, pre: Vec<f64>, post: Vec<f64>) -> Self {
        (self.0.actuation_time, self.0.pre_times, self.0.post_times) = (Some(actuation), Some(pre), Some(post));
        self
    }

    /// Sets the finger mode; the default is open.
    pub fn gripper(mut self, gripper: Gripper) -> Self {
        self.0.gripper = gripper;
        self
    }

    /// Makes the hand release the object at the end and retreat along its own z axis by `distance` (m), 0.01 to 0.3.
    pub fn let_go(mut self, distance: f64) -> Self {
        self.0.let_go = Some(distance);
        self
    }

    /// Returns the validated config.
    ///
    /// # Errors
    /// The same errors as for JSON text, with the same fields.
    pub fn build(self) -> Result<SolverConfig> {
        self.0.check()?;
        Ok(self.0)
    }
}

impl Constraint {
    /// Constrains a tool keypoint to an object keypoint: each coordinate in the base frame may differ by at most
    /// `tolerance` (m).
    #[must_use]
    pub fn point(keypoint: impl Into<String>, target: impl Into<String>, tolerance: f64) -> Self {
        let (keypoint, target) = (keypoint.into(), target.into());
        Self::Point { keypoint, target, offset: Vector3::zeros(), frame: Frame::World, tolerance }
    }

    /// Constrains the angle between a tool direction (from one tool keypoint to another) and a direction of the object.
    /// The angle may differ from `arccos(inner)` by at most `tolerance` (rad).
    #[must_use]
    pub fn axis(
        from: impl Into<String>,
        to: impl Into<String>,
        target: TargetAxis,
        inner: f64,
        tolerance: f64,
    ) -> Self {
        let on_frame = matches!(target, TargetAxis::Fixed { .. });
        let kind = match (on_frame, inner == 0.0) {
            (true, false) => "frame_axis_parallel",
            (true, true) => "frame_axis_orthogonal",
            (false, false) => "keypoint_axis_parallel",
            (false, true) => "keypoint_axis_orthogonal",
        };
        Self::Axis { kind: kind.to_owned(), from: from.into(), to: to.into(), target, inner, tolerance }
    }

    fn check(&self, at: &str) -> Result<()> {
        match self {
            Self::Point { keypoint, target, offset, tolerance, .. } => {
                named(keypoint, at, "keypoint_name")?;
                named(target, at, "target_keypoint_name")?;
                offset.iter().try_for_each(|v| number(*v, &format!("{at}.target_offset")))?;
                positive(*tolerance, at)
            }
            Self::Axis { from, to, target, inner, tolerance, .. } => {
                match target {
                    TargetAxis::Fixed { axis, .. } => unit(axis, at)?,
                    TargetAxis::Keypoints { from, to } => {
                        apart(from, to, at, ["target_axis_from_keypoint_name", "target_axis_to_keypoint_name"])?;
                    }
                }
                if !(-1.0..=1.0).contains(inner) {
                    let field = format!("{at}.target_inner_product");
                    return Err(ConfigError::new(field, format!("must lie between -1 and 1, not {inner}")));
                }
                apart(from, to, at, ["axis_from_keypoint_name", "axis_to_keypoint_name"])?;
                positive(*tolerance, at)
            }
            Self::PointCost { keypoint, target, weight } | Self::PlaneCost { keypoint, target, weight, .. } => {
                named(keypoint, at, "keypoint_name")?;
                named(target, at, "target_keypoint_name")?;
                if let Self::PlaneCost { normal, .. } = self {
                    unit(normal, at)?;
                }
                let field = format!("{at}.penalty_weight");
                number(*weight, &field)?;
                if *weight < 0.0 {
                    return Err(ConfigError::new(field, format!("must not be negative, not {weight}")));
                }
                Ok(())
            }
        }
    }
}

impl Motion {
    fn check(&self, at: &str) -> Result<()> {
        match *self {
            Self::Translate { axis, distance } => {
                if axis > 2 {
                    return Err(ConfigError::new(at, format!("translates along axis {axis}; use 0, 1 or 2")));
                }
                number(distance, at)
            }
            Self::Move(way) => way.iter().try_for_each(|v| number(*v, at)),
            Self::Rotate(v)
            | Self::FollowJoint(v)
            | Self::FollowJointTo(v)
            | Self::TraceJoint(v)
            | Self::TraceJointTo(v) => number(v, at),
        }
    }
}

impl SolverConfig {
    /// Checks the config: at least one constraint, numbers in range, unit directions, no motion that follows the
    /// object's joint before the actuation pose, and increasing times, one for each motion.
    pub(crate) fn check(&self) -> Result<()> {
        let lists = [
            ("constraint_list", self.constraints.len()),
            ("pre_actuation_motions", self.pre.len()),
            ("post_actuation_motions", self.post.len()),
        ];
        if let Some((field, count)) = lists.into_iter().find(|(_, count)| *count > MAX_ENTRIES) {
            return Err(ConfigError::new(field, format!("has {count} entries; at most {MAX_ENTRIES}")));
        }
        for (i, constraint) in self.constraints.iter().enumerate() {
            constraint.check(&format!("constraint_list[{i}]"))?;
        }
        if !self.constraints.iter().any(|c| matches!(c, Constraint::Point { .. } | Constraint::Axis { .. })) {
            return Err(ConfigError::new("constraint_list", "has no constraint; add a point2point_constraint"));
        }
        for (i, motion) in self.pre.iter().enumerate() {
            motion.check(&format!("pre_actuation_motions[{i}]"))?;
            if motion.follows_joint() {
                let message = "cannot follow the joint before the actuation pose; move it to post_actuation_motions";
                return Err(ConfigError::new(format!("pre_actuation_motions[{i}]"), message));
            }
        }
        for (i, motion) in self.post.iter().enumerate() {
            motion.check(&format!("post_actuation_motions[{i}]"))?;
        }
        if let Some(back) = self.let_go
            && !BACK.contains(&back)
        {
            let message = format!("must be {} to {} m, not {back}", BACK.start(), BACK.end());
            return Err(ConfigError::new("let_go", message));
        }
        let times = [
            ("pre_actuation_times", &self.pre_times, self.pre.len()),
            ("post_actuation_times", &self.post_times, self.post.len()),
        ];
        for (field, times, motions) in times {
            let Some(times) = times else { continue };
            if times.len() != motions {
                let message = format!("has {} times for {motions} motions; give one each", times.len());
                return Err(ConfigError::new(field, message));
            }
            times.iter().enumerate().try_for_each(|(i, t)| number(*t, &format!("{field}[{i}]")))?;
        }
        self.actuation_time.map_or(Ok(()), |t| number(t, "actuation_time"))?;
        if self.has_times() {
            self.clock(0.0)?;
        }
        Ok(())
    }
}

fn number(value: f64, field: &str) -> Result<()> {
    if value.abs() <= LARGEST { Ok(()) } else { Err(ConfigError::new(field, format!("{value} is out of range"))) }
}

fn positive(tolerance: f64, at: &str) -> Result<()> {
    let field = format!("{at}.tolerance");
    number(tolerance, &field)?;
    if tolerance > 0.0 {
        return Ok(());
    }
    Err(ConfigError::new(field, format!("must be positive, not {tolerance}")))
}

fn unit(axis: &Vector3<f64>, at: &str) -> Result<()> {
    if (axis.norm() - 1.0).abs() <= UNIT {
        return Ok(());
    }
    let message = format!("must be a unit vector, not {:?}", axis.as_slice());
    Err(ConfigError::new(format!("{at}.target_axis"), message))
}

fn named(name: &str, at: &str, field: &str) -> Result<()> {
    if name.is_empty() { Err(ConfigError::new(format!("{at}.{field}"), "is empty")) } else { Ok(()) }
}

fn apart(from: &str, to: &str, at: &str, fields: [&str; 2]) -> Result<()> {
    named(from, at, fields[0])?;
    named(to, at, fields[1])?;
    if from == to {
        let field = format!("{at}.{}", fields[1]);
        return Err(ConfigError::new(field, "is also the start of the axis; choose another keypoint"));
    }
    Ok(())
}
