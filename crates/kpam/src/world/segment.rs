//! Segments of a motion, each identified by the keyframe at its end.

use crate::SolverConfig;

/// A segment of a motion, identified by the keyframe at its end.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum MotionSegment {
    /// Free motion from the start to the first keyframe.
    Approach,
    /// Motion along the hand path to a pre-actuation keyframe; contains the index of its motion in the config's list.
    Pre(usize),
    /// Motion along the hand path to the actuation pose.
    ToActuation,
    /// Motion along the hand path to a post-actuation keyframe; contains the index of its motion in the config's list.
    Post(usize),
    /// Straight retreat of the hand after it has released the object.
    LetGo,
}

impl MotionSegment {
    /// Whether the segment lies after the actuation pose.
    pub fn is_after(self) -> bool {
        matches!(self, Self::Post(_) | Self::LetGo)
    }
}

/// Label of the keyframe at the end of the retreat.
const LET_GO: &str = "let_go";

/// Segments and keyframes of a motion in time order. Keyframe k is at the end of segment k.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Schedule {
    before: usize,
    after: usize,
    lets_go: bool,
}

impl Schedule {
    /// Returns the segments and keyframes that a config defines.
    pub fn of(config: &SolverConfig) -> Self {
        Self { before: config.pre.len(), after: config.post.len(), lets_go: config.let_go.is_some() }
    }

    /// Number of segments.
    pub fn len(&self) -> usize {
        self.before + 1 + self.after + usize::from(self.lets_go)
    }

    /// Index of the actuation pose in the time order of keyframes.
    pub fn actuation(&self) -> usize {
        self.before
    }

    /// Index in time order of the keyframe at which the hand releases the object, if it does.
    pub fn lets_go_at(&self) -> Option<usize> {
        self.lets_go.then_some(self.before + self.after)
    }

    /// Label of a keyframe; keyframes are numbered in time order from 0.
    pub fn label(&self, keyframe: usize) -> String {
        match self.toward(keyframe) {
            _ if keyframe < self.before => format!("pre_{}", self.before - 1 - keyframe),
            MotionSegment::Post(i) => format!("post_{i}"),
            MotionSegment::LetGo => LET_GO.to_owned(),
            MotionSegment::Approach | MotionSegment::Pre(_) | MotionSegment::ToActuation => "actuation".to_owned(),
        }
    }

    /// Index in time order of the keyframe with a label.
    pub fn keyframe(&self, label: &str) -> Option<usize> {
        let numbered = |prefix: &str, count: usize| {
            label.strip_prefix(prefix).and_then(|n| n.parse::<usize>().ok()).filter(|n| *n < count)
        };
        match label {
            "actuation" => Some(self.before),
            LET_GO => self.lets_go_at().map(|k| k + 1),
            _ => numbered("pre_", self.before)
                .map(|i| self.before - 1 - i)
                .or_else(|| numbered("post_", self.after).map(|i| self.before + 1 + i)),
        }
    }

    /// Returns the segment that ends at keyframe `keyframe`; keyframes are numbered in time order from 0.
    pub fn toward(&self, keyframe: usize) -> MotionSegment {
        if keyframe == 0 {
            MotionSegment::Approach
        } else if keyframe < self.before {
            MotionSegment::Pre(self.before - 1 - keyframe)
        } else if keyframe == self.before {
            MotionSegment::ToActuation
        } else if self.lets_go_at().is_some_and(|at| keyframe > at) {
            MotionSegment::LetGo
        } else {
            MotionSegment::Post(keyframe - self.before - 1)
        }
    }

    /// Returns the segment along hand path `path`; paths are numbered in time order from 0.
    pub fn along(&self, path: usize) -> MotionSegment {
        self.toward(path + 1)
    }

    /// Returns the segment that ends at the actuation pose, which may be the approach.
    pub fn last_before_actuation(&self) -> MotionSegment {
        self.toward(self.before)
    }

    /// Returns the segment that begins at the actuation pose, if any.
    pub fn first_after_actuation(&self) -> Option<MotionSegment> {
        (self.before + 1 < self.len()).then(|| self.toward(self.before + 1))
    }

    /// Index in time order of the keyframe at the end of a segment.
    pub fn number(&self, segment: MotionSegment) -> usize {
        match segment {
            MotionSegment::Approach => 0,
            MotionSegment::Pre(i) => self.before - 1 - i,
            MotionSegment::ToActuation => self.before,
            MotionSegment::Post(i) => self.before + 1 + i,
            MotionSegment::LetGo => self.before + 1 + self.after,
        }
    }

    /// All segments in time order.
    pub fn segments(&self) -> impl Iterator<Item = MotionSegment> + use<> {
        let schedule = *self;
        (0..self.len()).map(move |k| schedule.toward(k))
    }
}

impl std::fmt::Display for Schedule {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let labels: Vec<String> = (0..self.len()).map(|k| self.label(k)).collect();
        f.write_str(&labels.join(", "))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn legs_and_keyframes_are_numbered_alike() {
        for (before, after) in [(0, 0), (0, 2), (1, 1), (3, 2)] {
            for lets_go in [false, true] {
                let schedule = Schedule { before, after, lets_go };
                for (k, segment) in schedule.segments().enumerate() {
                    assert_eq!(schedule.number(segment), k, "{segment:?}");
                    assert_eq!(schedule.keyframe(&schedule.label(k)), Some(k), "{segment:?}");
                }
                assert_eq!(schedule.number(schedule.last_before_actuation()), before);
            }
        }
    }

    #[test]
    fn pre_actuation_motions_count_from_the_actuation() {
        let schedule = Schedule { before: 3, after: 1, lets_go: true };
        let segments: Vec<MotionSegment> = schedule.segments().collect();
        assert_eq!(
            segments,
            [
                MotionSegment::Approach,
                MotionSegment::Pre(1),
                MotionSegment::Pre(0),
                MotionSegment::ToActuation,
                MotionSegment::Post(0),
                MotionSegment::LetGo
            ]
        );
        assert_eq!(schedule.to_string(), "pre_2, pre_1, pre_0, actuation, post_0, let_go");
    }
}
