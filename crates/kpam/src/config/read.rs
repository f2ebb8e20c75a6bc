//! Reads configs from JSON; each error names the path of the field.

use nalgebra::Vector3;
use serde_json::{Map, Value};

use super::build::{LARGEST, MAX_ENTRIES};
use super::{Constraint, Frame, Gripper, Motion, Result, SolverConfig, TargetAxis};
use crate::ConfigError;

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
    "let_go",
];

const NAMED: &[(&str, [f64; 3])] = &[
    ("move-up", [0.0, 0.0, 0.06]),
    ("move-down", [0.0, 0.0, -0.06]),
    ("move-left", [0.0, 0.08, 0.0]),
    ("move-right", [0.0, -0.08, 0.0]),
    ("move-forward", [0.1, 0.0, 0.0]),
    ("move-backward", [-0.1, 0.0, 0.0]),
];

impl SolverConfig {
    /// Reads a config from a JSON value.
    ///
    /// # Errors
    /// The same as for [`SolverConfig::from_json`].
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
        let pre = motions(top, "pre_actuation_motions")?;
        let post = motions(top, "post_actuation_motions")?;
        let actuation_time = present(top, "actuation_time").map(|v| number(v, "actuation_time")).transpose()?;
        let pre_times = times(top, "pre_actuation_times")?;
        let post_times = times(top, "post_actuation_times")?;
        let gripper = match present(top, "gripper") {
            None => Gripper::Open,
            Some(v) => match text(v, "gripper")? {
                "open" => Gripper::Open,
                "closed" => Gripper::Closed,
                "grasp" => Gripper::Grasp,
                "hold" => Gripper::Hold,
                "release" => Gripper::Release,
                other => {
                    let message = format!("must be open, closed, grasp, hold or release, not {other:?}");
                    return Err(ConfigError::new("gripper", message));
                }
            },
        };
        let let_go = present(top, "let_go").map(|v| number(v, "let_go")).transpose()?;
        let source = value.to_string();
        let config = Self { constraints, pre, post, actuation_time, pre_times, post_times, gripper, let_go, source };
        config.check()?;
        Ok(config)
    }
}

fn constraint(value: &Value, at: &str) -> Result<Constraint> {
    let map = object(value, at)?;
    let kind = text(required(map, "type", at)?, &format!("{at}.type"))?;
    let name = |field: &str| text(required(map, field, at)?, &format!("{at}.{field}")).map(str::to_owned);
    let tolerance = || number(required(map, "tolerance", at)?, &format!("{at}.tolerance"));
    let weight = || present(map, "penalty_weight").map_or(Ok(1.0), |v| number(v, &format!("{at}.penalty_weight")));
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
                TargetAxis::Keypoints { from, to }
            };
            let field = format!("{at}.target_inner_product");
            let inner = number(required(map, "target_inner_product", at)?, &field)?;
            let (from, to) = (name("axis_from_keypoint_name")?, name("axis_to_keypoint_name")?);
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
        // Configs of the original GenSim2 mistakenly write the constraint's type in this field. Its solver uses world
        // axes for every value except "object".
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

fn times(map: &Map<String, Value>, name: &str) -> Result<Option<Vec<f64>>> {
    let Some(value) = present(map, name) else { return Ok(None) };
    let entries = list(value, name)?;
    entries.iter().enumerate().map(|(i, v)| number(v, &format!("{name}[{i}]"))).collect::<Result<Vec<_>>>().map(Some)
}

/// Returns the value of a field that exists and is not null.
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
    if entries.len() > MAX_ENTRIES {
        return Err(ConfigError::new(at, format!("has {} entries; at most {MAX_ENTRIES}", entries.len())));
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
