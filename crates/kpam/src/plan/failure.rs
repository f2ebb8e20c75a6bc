//! Reasons why a motion ends early.

use nalgebra::Vector3;

use super::Lack;
use crate::world::Hit;

/// Reason why the hand cannot follow its path any further.
#[derive(Debug, Clone)]
pub(super) struct PathEnd {
    /// Translation (m, base frame) by which the hand's origin still misses its goal.
    pub left: Vector3<f64>,
    /// The joint that is at a limit, if any, and the limit.
    pub limit: Option<String>,
}

impl PathEnd {
    fn told(&self) -> String {
        let [x, y, z] = [self.left.x, self.left.y, self.left.z];
        let left = format!("({x:.3}, {y:.3}, {z:.3}) m in the base frame remain");
        match &self.limit {
            Some(limit) => format!("{left}, and {limit}"),
            None => format!("{left}; no joint is at a limit: the arm is stretched or singular there"),
        }
    }
}

/// Reason why a candidate's motion ends early. Keyframes are numbered in time order.
#[derive(Debug, Clone)]
pub(super) enum Failure {
    /// The hand can follow only this fraction of the path to this keyframe; `end` holds the reason.
    Unreachable { keyframe: usize, fraction: f64, end: PathEnd },
    /// At the start, the robot overlaps a body by more than the problem allows.
    Inside { keyframe: usize, hit: Hit },
    /// An obstacle blocks the path to this keyframe.
    Blocked { keyframe: usize, hit: Hit },
    /// No collision-free motion to this keyframe was found; this obstacle blocks the straight segment.
    NotFound { keyframe: usize, hit: Hit },
    /// The times in the config leave less time (s) for the motion to this keyframe than the motion needs.
    TooFast { keyframe: usize, allowed: f64, needed: f64 },
    /// No motion along the path to this keyframe keeps the joint limits from the state at the path's start.
    Untimed { keyframe: usize },
    /// Planning was cancelled, or its time was up, before the motion to this keyframe was proven.
    Unproven { keyframe: usize },
}

impl Failure {
    /// Index of the first keyframe that the motion does not reach.
    pub fn keyframe(&self) -> usize {
        match self {
            Self::Unreachable { keyframe, .. }
            | Self::Inside { keyframe, .. }
            | Self::Blocked { keyframe, .. }
            | Self::NotFound { keyframe, .. }
            | Self::TooFast { keyframe, .. }
            | Self::Untimed { keyframe }
            | Self::Unproven { keyframe } => *keyframe,
        }
    }

    /// Returns the kind of the failure.
    pub fn lack(&self) -> Lack {
        match self {
            Self::Unreachable { .. } => Lack::Unreachable,
            Self::Inside { .. } => Lack::StartInCollision,
            Self::Blocked { .. } => Lack::Collision,
            Self::NotFound { .. } | Self::Unproven { .. } => Lack::NotFound,
            Self::TooFast { .. } => Lack::TooFast,
            Self::Untimed { .. } => Lack::Untimed,
        }
    }

    /// Explains the failure in one sentence; `label` returns the name of a keyframe for its index.
    pub fn reason(&self, label: impl Fn(usize) -> String) -> String {
        match self {
            Self::Unreachable { keyframe, fraction, end } => {
                let told = end.told();
                format!(
                    "{} is out of reach: the hand covers {:.0} % of the way; {told}",
                    label(*keyframe),
                    100.0 * fraction
                )
            }
            Self::Inside { hit, .. } => inside(hit),
            Self::Blocked { keyframe, hit } => {
                format!("{} on the way to {}, {}", meeting(hit), label(*keyframe), place(hit))
            }
            Self::NotFound { keyframe, hit } => format!(
                "no collision-free motion to {} was found; on the straight motion to it {}, {}",
                label(*keyframe),
                meeting(hit),
                place(hit)
            ),
            Self::TooFast { keyframe, allowed, needed } => {
                format!("the config allows {allowed:.2} s to {}, but the joints need {needed:.2} s", label(*keyframe))
            }
            Self::Untimed { keyframe } => {
                format!("no motion to {} from the start velocity keeps the joint limits", label(*keyframe))
            }
            Self::Unproven { keyframe } => {
                format!("the planner was stopped before the motion to {} was complete", label(*keyframe))
            }
        }
    }
}

/// Describes an overlap at the start that is too deep for planning.
pub(super) fn inside(hit: &Hit) -> String {
    format!("{} at the start, {}", meeting(hit), place(hit))
}

/// Says how far two bodies overlap or how close they come.
pub(super) fn meeting(hit: &Hit) -> String {
    let verb = if hit.distance < 0.0 { "overlap by" } else { "come within" };
    format!("{} and {} {verb} {}", hit.first, hit.second, millimetres(hit.distance.abs()))
}

/// Formats a length (m, not negative) in millimetres.
pub(super) fn millimetres(length: f64) -> String {
    let tenths = (1e4 * length).round();
    if length > 0.0 && tenths < 1.0 { "less than 0.1 mm".to_owned() } else { format!("{} mm", tenths / 10.0) }
}

fn place(hit: &Hit) -> String {
    format!("at ({:.3}, {:.3}, {:.3})", hit.at.x, hit.at.y, hit.at.z)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn met(distance: f64) -> String {
        meeting(&Hit { first: "hand".to_owned(), second: "lid".to_owned(), distance, at: nalgebra::Point3::origin() })
    }

    #[test]
    fn an_overlap_is_no_negative_distance() {
        assert_eq!(met(-0.0057), "hand and lid overlap by 5.7 mm");
        assert_eq!(met(-1e-6), "hand and lid overlap by less than 0.1 mm");
        assert_eq!(met(0.03), "hand and lid come within 30 mm");
    }
}
