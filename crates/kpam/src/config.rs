//! The solver config language: keypoint constraints, and motions before and after the actuation pose.

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use crate::ConfigError;

/// Frame in which a config writes a direction.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Frame {
    /// World axes.
    World,
    /// The object frame.
    Object,
    /// The joint frame at the config's target keypoint: y as the keypoint moves on opening, z the joint axis, x = y × z.
    Joint,
}

/// Direction on the object that an axis constraint speaks of.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum TargetAxis {
    /// Unit direction in a frame.
    Fixed {
        /// The direction.
        axis: Vector3<f64>,
        /// Its frame.
        frame: Frame,
    },
    /// From one keypoint of the object to another.
    Keypoints {
        /// Where it begins.
        from: String,
        /// Where it ends.
        to: String,
    },
}

/// One entry of `constraint_list`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum Constraint {
    /// `point2point_constraint`: each base coordinate of the keypoint within `tolerance` (m) of the target's.
    Point {
        /// Keypoint of the tool.
        keypoint: String,
        /// Keypoint of the object.
        target: String,
        /// Shift of the target (m).
        offset: Vector3<f64>,
        /// Frame of the shift.
        frame: Frame,
        /// Half width (m).
        tolerance: f64,
    },
    /// The four axis constraints: angle between two directions within `tolerance` (rad) of `arccos(inner)`.
    Axis {
        /// Type as written.
        kind: String,
        /// Tool keypoint where the tool's direction begins.
        from: String,
        /// Tool keypoint where it ends.
        to: String,
        /// Direction on the object.
        target: TargetAxis,
        /// Target inner product.
        inner: f64,
        /// Half width (rad).
        tolerance: f64,
    },
    /// `point2point_cost`: weight times the squared distance (m^2) of two keypoints.
    PointCost {
        /// Keypoint of the tool.
        keypoint: String,
        /// Keypoint of the object.
        target: String,
        /// Weight.
        weight: f64,
    },
    /// `point2plane_cost`: weight times the squared distance (m^2) of a keypoint from a plane through the target.
    PlaneCost {
        /// Keypoint of the tool.
        keypoint: String,
        /// Keypoint of the object.
        target: String,
        /// Unit normal.
        normal: Vector3<f64>,
        /// Frame of the normal.
        frame: Frame,
        /// Weight.
        weight: f64,
    },
}

impl Constraint {
    /// Name for reports: the type and what it binds.
    #[must_use]
    pub fn name(&self) -> String {
        match self {
            Self::Point { keypoint, target, .. } => format!("point2point_constraint({keypoint}, {target})"),
            Self::Axis { kind, from, to, target, .. } => match target {
                TargetAxis::Fixed { axis, frame } => {
                    format!("{kind}({from} -> {to}, {} axis [{}, {}, {}])", frame.name(), axis.x, axis.y, axis.z)
                }
                TargetAxis::Keypoints { from: a, to: b } => format!("{kind}({from} -> {to}, {a} -> {b})"),
            },
            Self::PointCost { keypoint, target, .. } => format!("point2point_cost({keypoint}, {target})"),
            Self::PlaneCost { keypoint, target, .. } => format!("point2plane_cost({keypoint}, {target})"),
        }
    }
}

impl Frame {
    fn name(self) -> &'static str {
        match self {
            Self::World => "world",
            Self::Object => "object",
            Self::Joint => "joint",
        }
    }
}

/// One entry of a motion list.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub enum Motion {
    /// Translation along axis 0, 1 or 2 of the hand (m).
    Translate {
        /// Hand axis.
        axis: usize,
        /// Metres.
        distance: f64,
    },
    /// Named translation along base axes (m).
    Move(Vector3<f64>),
    /// Rotation about the object axis through the object frame's origin (rad).
    Rotate(f64),
    /// Moves the hand with the object's joint by so much (rad or m).
    FollowJoint(f64),
    /// Moves the hand with the object's joint to this openness (0..1, may overshoot).
    FollowJointTo(f64),
    /// Moves the tool keypoint of the point constraint with the object's joint by so much (rad or m); the hand keeps
    /// its orientation.
    TraceJoint(f64),
    /// The same to this openness (0..1, may overshoot).
    TraceJointTo(f64),
}

impl Motion {
    /// Whether the motion needs the object's joint.
    pub fn follows_joint(&self) -> bool {
        matches!(self, Self::FollowJoint(_) | Self::FollowJointTo(_) | Self::TraceJoint(_) | Self::TraceJointTo(_))
    }
}

/// What the fingers do.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Gripper {
    /// Open throughout.
    Open,
    /// Closed throughout.
    Closed,
    /// Closing at the actuation pose.
    Grasp,
}

/// A validated solver config.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SolverConfig {
    /// Constraints and costs of the actuation pose.
    pub constraints: Vec<Constraint>,
    /// Motions before the actuation pose; the last one is next to it.
    pub pre: Vec<Motion>,
    /// Motions after it.
    pub post: Vec<Motion>,
    /// Time of the actuation pose (s).
    pub actuation_time: Option<f64>,
    /// Times of the pre-actuation keyframes (s), one each.
    pub pre_times: Option<Vec<f64>>,
    /// Times of the post-actuation keyframes (s), one each.
    pub post_times: Option<Vec<f64>>,
    /// Fingers.
    pub gripper: Gripper,
    /// The config as JSON text, as it was given.
    pub source: String,
}

const TOP: &[&str] = &[
    "task_name",
    "category_name",
    "tool_keypoint_name_list",
    "object_keypoint_name_list",
    "constraint_list",
    "pre_actuation_motions",
    "post_actuation_motions",
    "actuation_time",
    "pre_actuation_times",
    "post_actuation_times",
    "gripper",
];

const NAMED: &[(&str, [f64; 3])] = &[
    ("move-up", [0.0, 0.0, 0.06]),
    ("move-down", [0.0, 0.0, -0.06]),
    ("move-left", [0.0, 0.08, 0.0]),
    ("move-right", [0.0, -0.08, 0.0]),
    ("move-forward", [0.1, 0.0, 0.0]),
    ("move-backward", [-0.1, 0.0, 0.0]),
];

/// Entries that a list may have; longer ones are taken for damage.
const MOST_ENTRIES: usize = 200;

type Result<T> = std::result::Result<T, ConfigError>;

impl SolverConfig {
    /// Reads JSON text.
    ///
    /// # Errors
    /// Anything but the documented language, with the field's path.
    ///
    /// ```
    /// let bad = gensim2_kpam::SolverConfig::from_json(r#"{"constraint_list": [], "speed": 2}"#);
    /// assert_eq!(bad.unwrap_err().field, "speed");
    /// ```
    pub fn from_json(text: &str) -> Result<Self> {
        let value: Value = serde_json::from_str(text).map_err(|e| ConfigError::new("config", format!("{e}")))?;
        Self::from_value(&value)
    }

    /// Reads a JSON value.
    ///
    /// # Errors
    /// As [`SolverConfig::from_json`].
    pub fn from_value(value: &Value) -> Result<Self> {
        let top = object(value, "config")?;
        only(top, TOP, "")?;
        for name in ["task_name", "category_name"] {
            if let Some(v) = present(top, name) {
                text(v, name)?;
            }
        }
        for name in ["tool_keypoint_name_list", "object_keypoint_name_list"] {
            if let Some(v) = present(top, name) {
                for (i, entry) in list(v, name)?.iter().enumerate() {
                    text(entry, &format!("{name}[{i}]"))?;
                }
            }
        }
        let entries = present(top, "constraint_list")
            .ok_or_else(|| ConfigError::new("constraint_list", "is missing; list at least one constraint"))?;
        let entries = list(entries, "constraint_list")?;
        let constraints = entries
            .iter()
            .enumerate()
            .map(|(i, e)| constraint(e, &format!("constraint_list[{i}]")))
            .collect::<Result<Vec<_>>>()?;
        if !constraints.iter().any(|c| matches!(c, Constraint::Point { .. } | Constraint::Axis { .. })) {
            return Err(ConfigError::new("constraint_list", "holds no constraint; add a point2point_constraint"));
        }
        let pre = motions(top, "pre_actuation_motions")?;
        let post = motions(top, "post_actuation_motions")?;
        if let Some(i) = pre.iter().position(Motion::follows_joint) {
            let message = "cannot follow the joint before the actuation pose; move it to post_actuation_motions";
            return Err(ConfigError::new(format!("pre_actuation_motions[{i}]"), message));
        }
        let actuation_time = present(top, "actuation_time").map(|v| number(v, "actuation_time")).transpose()?;
        let pre_times = times(top, "pre_actuation_times", pre.len())?;
        let post_times = times(top, "post_actuation_times", post.len())?;
        let gripper = match present(top, "gripper") {
            None => Gripper::Open,
            Some(v) => match text(v, "gripper")? {
                "open" => Gripper::Open,
                "closed" => Gripper::Closed,
                "grasp" => Gripper::Grasp,
                other => {
                    return Err(ConfigError::new("gripper", format!("must be open, closed or grasp, not {other:?}")));
                }
            },
        };
        let source = value.to_string();
        let config = Self { constraints, pre, post, actuation_time, pre_times, post_times, gripper, source };
        if config.has_times() {
            config.clock(0.0)?;
        }
        Ok(config)
    }

    /// Whether the config sets any time.
    #[must_use]
    pub fn has_times(&self) -> bool {
        self.actuation_time.is_some() || self.pre_times.is_some() || self.post_times.is_some()
    }

    /// Keyframe times (s) on the config's clock: pre-actuation, actuation, post-actuation. Where it sets none, the
    /// actuation is at 24 and motions are 4 apart.
    ///
    /// # Errors
    /// Times that do not increase from `start`.
    pub fn clock(&self, start: f64) -> Result<Vec<f64>> {
        const STEP: f64 = 4.0;
        let actuation = self.actuation_time.unwrap_or(24.0);
        let before = self.pre.len();
        let mut out = match &self.pre_times {
            Some(t) => t.clone(),
            None => (0..before).map(|i| actuation - STEP * (before - i) as f64).collect(),
        };
        out.push(actuation);
        match &self.post_times {
            Some(t) => out.extend_from_slice(t),
            None => out.extend((0..self.post.len()).map(|i| actuation + STEP * (i + 1) as f64)),
        }
        let mut last = start;
        for (i, t) in out.iter().enumerate() {
            if *t <= last {
                let field = match i.cmp(&before) {
                    std::cmp::Ordering::Less => format!("pre_actuation_times[{i}]"),
                    std::cmp::Ordering::Equal => "actuation_time".to_owned(),
                    std::cmp::Ordering::Greater => format!("post_actuation_times[{}]", i - before - 1),
                };
                return Err(ConfigError::new(field, format!("{t} s must come after {last} s")));
            }
            last = *t;
        }
        Ok(out)
    }

    /// The keypoint that the joint frame stands at: the target of the first point constraint.
    #[must_use]
    pub fn target_keypoint(&self) -> Option<&str> {
        self.constraints.iter().find_map(|c| match c {
            Constraint::Point { target, .. } => Some(target.as_str()),
            _ => None,
        })
    }
}

fn constraint(value: &Value, at: &str) -> Result<Constraint> {
    let map = object(value, at)?;
    let kind = text(required(map, "type", at)?, &format!("{at}.type"))?;
    let name = |field: &str| text(required(map, field, at)?, &format!("{at}.{field}")).map(str::to_owned);
    let tolerance = || {
        let field = format!("{at}.tolerance");
        let t = number(required(map, "tolerance", at)?, &field)?;
        if t <= 0.0 { Err(ConfigError::new(field, format!("must be positive, not {t}"))) } else { Ok(t) }
    };
    let weight = || {
        let field = format!("{at}.penalty_weight");
        let w = present(map, "penalty_weight").map_or(Ok(1.0), |v| number(v, &field))?;
        if w < 0.0 { Err(ConfigError::new(field, format!("must not be negative, not {w}"))) } else { Ok(w) }
    };
    match kind {
        "point2point_constraint" => {
            let known = [
                "type",
                "name",
                "keypoint_name",
                "target_keypoint_name",
                "tolerance",
                "target_offset",
                "target_offset_frame",
            ];
            only(map, &known, at)?;
            let offset = match present(map, "target_offset") {
                Some(v) => vector(v, &format!("{at}.target_offset"))?,
                None => Vector3::zeros(),
            };
            let frame = frame_of(map, "target_offset_frame", at, Some(Frame::World))?;
            Ok(Constraint::Point {
                keypoint: name("keypoint_name")?,
                target: name("target_keypoint_name")?,
                offset,
                frame,
                tolerance: tolerance()?,
            })
        }
        "frame_axis_parallel" | "frame_axis_orthogonal" | "keypoint_axis_parallel" | "keypoint_axis_orthogonal" => {
            let on_frame = kind.starts_with("frame");
            let mut known = vec![
                "type",
                "name",
                "axis_from_keypoint_name",
                "axis_to_keypoint_name",
                "tolerance",
                "target_inner_product",
            ];
            known.extend(if on_frame {
                ["target_axis", "target_axis_frame"]
            } else {
                ["target_axis_from_keypoint_name", "target_axis_to_keypoint_name"]
            });
            only(map, &known, at)?;
            let target = if on_frame {
                let frame = frame_of(map, "target_axis_frame", at, None)?;
                TargetAxis::Fixed { axis: direction(map, "target_axis", at)?, frame }
            } else {
                let from = name("target_axis_from_keypoint_name")?;
                let to = name("target_axis_to_keypoint_name")?;
                if from == to {
                    let field = format!("{at}.target_axis_to_keypoint_name");
                    return Err(ConfigError::new(field, "is where the axis begins; name another keypoint"));
                }
                TargetAxis::Keypoints { from, to }
            };
            let field = format!("{at}.target_inner_product");
            let inner = number(required(map, "target_inner_product", at)?, &field)?;
            if !(-1.0..=1.0).contains(&inner) {
                return Err(ConfigError::new(field, format!("must lie between -1 and 1, not {inner}")));
            }
            let (from, to) = (name("axis_from_keypoint_name")?, name("axis_to_keypoint_name")?);
            if from == to {
                let field = format!("{at}.axis_to_keypoint_name");
                return Err(ConfigError::new(field, "is where the axis begins; name another keypoint"));
            }
            Ok(Constraint::Axis { kind: kind.to_owned(), from, to, target, inner, tolerance: tolerance()? })
        }
        "point2point_cost" => {
            only(map, &["type", "name", "keypoint_name", "target_keypoint_name", "penalty_weight"], at)?;
            let (keypoint, target) = (name("keypoint_name")?, name("target_keypoint_name")?);
            Ok(Constraint::PointCost { keypoint, target, weight: weight()? })
        }
        "point2plane_cost" => {
            let known = [
                "type",
                "name",
                "keypoint_name",
                "target_keypoint_name",
                "penalty_weight",
                "target_axis",
                "target_axis_frame",
            ];
            only(map, &known, at)?;
            Ok(Constraint::PlaneCost {
                keypoint: name("keypoint_name")?,
                target: name("target_keypoint_name")?,
                normal: direction(map, "target_axis", at)?,
                frame: frame_of(map, "target_axis_frame", at, None)?,
                weight: weight()?,
            })
        }
        other => Err(ConfigError::new(
            format!("{at}.type"),
            format!(
                "{other:?} is unknown; use point2point_constraint, frame_axis_parallel, frame_axis_orthogonal, \
                 keypoint_axis_parallel, keypoint_axis_orthogonal, point2point_cost or point2plane_cost"
            ),
        )),
    }
}

fn direction(map: &Map<String, Value>, field: &str, at: &str) -> Result<Vector3<f64>> {
    let path = format!("{at}.{field}");
    let v = vector(required(map, field, at)?, &path)?;
    let length = v.norm();
    if length > 1e-9 && length.is_finite() {
        Ok(v / length)
    } else {
        Err(ConfigError::new(path, "has no direction; give e.g. [0, 0, 1]"))
    }
}

fn frame_of(map: &Map<String, Value>, field: &str, at: &str, default: Option<Frame>) -> Result<Frame> {
    let path = format!("{at}.{field}");
    let value = match (present(map, field), default) {
        (Some(v), _) => v,
        (None, Some(frame)) => return Ok(frame),
        (None, None) => return Err(ConfigError::new(path, "is missing; use world, object or joint")),
    };
    match text(value, &path)? {
        "world" => Ok(Frame::World),
        "object" => Ok(Frame::Object),
        "joint" => Ok(Frame::Joint),
        // A config of the original has its constraint's type here by mistake; the original reads what is not "object"
        // as world axes.
        "frame_axis_parallel" | "frame_axis_orthogonal" => Ok(Frame::World),
        other => Err(ConfigError::new(path, format!("must be world, object or joint, not {other:?}"))),
    }
}

fn motions(map: &Map<String, Value>, name: &str) -> Result<Vec<Motion>> {
    let Some(value) = present(map, name) else { return Ok(Vec::new()) };
    list(value, name)?.iter().enumerate().map(|(i, m)| motion(m, &format!("{name}[{i}]"))).collect()
}

fn motion(value: &Value, at: &str) -> Result<Motion> {
    let known = "translate_x, translate_y, translate_z, rotate, follow_joint, follow_joint_to, trace_joint, trace_joint_to \
                 with a number, or move-up, move-down, move-left, move-right, move-forward, move-backward";
    let named = |word: &str| NAMED.iter().find(|(n, _)| *n == word).map(|(_, v)| Motion::Move(Vector3::from(*v)));
    if let Value::String(word) = value {
        return named(word).ok_or_else(|| ConfigError::new(at, format!("{word:?} is unknown; use {known}")));
    }
    let parts = list(value, at)?;
    let word = match parts.first() {
        Some(v) => text(v, &format!("{at}[0]"))?,
        None => return Err(ConfigError::new(at, format!("is empty; use {known}"))),
    };
    if let (1, Some(m)) = (parts.len(), named(word)) {
        return Ok(m);
    }
    if parts.len() != 2 {
        return Err(ConfigError::new(at, format!("has {} entries; write [name, number]", parts.len())));
    }
    let v = number(&parts[1], &format!("{at}[1]"))?;
    match word {
        "translate_x" => Ok(Motion::Translate { axis: 0, distance: v }),
        "translate_y" => Ok(Motion::Translate { axis: 1, distance: v }),
        "translate_z" => Ok(Motion::Translate { axis: 2, distance: v }),
        "rotate" => Ok(Motion::Rotate(v)),
        "follow_joint" => Ok(Motion::FollowJoint(v)),
        "follow_joint_to" => Ok(Motion::FollowJointTo(v)),
        "trace_joint" => Ok(Motion::TraceJoint(v)),
        "trace_joint_to" => Ok(Motion::TraceJointTo(v)),
        other => Err(ConfigError::new(format!("{at}[0]"), format!("{other:?} is unknown; use {known}"))),
    }
}

fn times(map: &Map<String, Value>, name: &str, motions: usize) -> Result<Option<Vec<f64>>> {
    let Some(value) = present(map, name) else { return Ok(None) };
    let entries = list(value, name)?;
    if entries.len() != motions {
        let message = format!("has {} times for {motions} motions; give one each", entries.len());
        return Err(ConfigError::new(name, message));
    }
    entries.iter().enumerate().map(|(i, v)| number(v, &format!("{name}[{i}]"))).collect::<Result<Vec<_>>>().map(Some)
}

/// A field that is there and not null.
fn present<'a>(map: &'a Map<String, Value>, field: &str) -> Option<&'a Value> {
    map.get(field).filter(|v| !v.is_null())
}

fn required<'a>(map: &'a Map<String, Value>, field: &str, at: &str) -> Result<&'a Value> {
    present(map, field).ok_or_else(|| ConfigError::new(format!("{at}.{field}"), "is missing"))
}

fn only(map: &Map<String, Value>, known: &[&str], at: &str) -> Result<()> {
    match map.keys().find(|k| !known.contains(&k.as_str())) {
        Some(k) => {
            let field = if at.is_empty() { k.clone() } else { format!("{at}.{k}") };
            Err(ConfigError::new(field, format!("is not a known field; known: {}", known.join(", "))))
        }
        None => Ok(()),
    }
}

fn object<'a>(value: &'a Value, at: &str) -> Result<&'a Map<String, Value>> {
    value.as_object().ok_or_else(|| ConfigError::new(at, format!("must be a mapping, not {}", kind_of(value))))
}

fn list<'a>(value: &'a Value, at: &str) -> Result<&'a Vec<Value>> {
    let entries =
        value.as_array().ok_or_else(|| ConfigError::new(at, format!("must be a list, not {}", kind_of(value))))?;
    if entries.len() > MOST_ENTRIES {
        return Err(ConfigError::new(at, format!("has {} entries; at most {MOST_ENTRIES}", entries.len())));
    }
    Ok(entries)
}

fn text<'a>(value: &'a Value, at: &str) -> Result<&'a str> {
    match value.as_str() {
        Some("") => Err(ConfigError::new(at, "is empty")),
        Some(s) => Ok(s),
        None => Err(ConfigError::new(at, format!("must be text, not {}", kind_of(value)))),
    }
}

/// Numbers beyond this are taken for damage: metres, radians and seconds of a table-top scene are far smaller.
const LARGEST: f64 = 1e6;

fn number(value: &Value, at: &str) -> Result<f64> {
    match value {
        Value::Number(n) => match n.as_f64() {
            Some(v) if v.is_finite() && v.abs() <= LARGEST => Ok(v),
            _ => Err(ConfigError::new(at, format!("{n} is out of range"))),
        },
        Value::String(s) if s.parse::<f64>().is_ok() => {
            Err(ConfigError::new(at, format!("is the text {s:?}, not a number; YAML wants 1.0e-4, not 1e-4")))
        }
        other => Err(ConfigError::new(at, format!("must be a finite number, not {}", kind_of(other)))),
    }
}

fn vector(value: &Value, at: &str) -> Result<Vector3<f64>> {
    let entries = list(value, at)?;
    if entries.len() != 3 {
        return Err(ConfigError::new(at, format!("has {} numbers; give three", entries.len())));
    }
    let mut out = Vector3::zeros();
    for (i, v) in entries.iter().enumerate() {
        out[i] = number(v, &format!("{at}[{i}]"))?;
    }
    Ok(out)
}

fn kind_of(value: &Value) -> &'static str {
    match value {
        Value::Null => "nothing",
        Value::Bool(_) => "true or false",
        Value::Number(_) => "a number",
        Value::String(_) => "text",
        Value::Array(_) => "a list",
        Value::Object(_) => "a mapping",
    }
}
