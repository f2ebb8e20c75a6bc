//! The legs of a motion: its parts, each by the keyframe that it leads to.

use crate::SolverConfig;

/// A part of a motion, by the keyframe that it leads to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Leg {
    /// Free motion from the start to the first keyframe.
    Approach,
    /// Along the hand's path to a pre-actuation keyframe, by its number in the config's list.
    Pre(usize),
    /// Along the hand's path to the actuation pose.
    ToActuation,
    /// Along the hand's path to a post-actuation keyframe, by its number in the config's list.
    Post(usize),
}

/// Legs and keyframes of a motion in time. Keyframe k of a motion is what leg k leads to.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Course {
    before: usize,
    after: usize,
}

impl Course {
    /// That of a config.
    pub fn of(config: &SolverConfig) -> Self {
        Self { before: config.pre.len(), after: config.post.len() }
    }

    /// Number of legs.
    pub fn len(&self) -> usize {
        self.before + 1 + self.after
    }

    /// The leg to keyframe number `keyframe` in time.
    pub fn toward(&self, keyframe: usize) -> Leg {
        if keyframe == 0 {
            Leg::Approach
        } else if keyframe < self.before {
            Leg::Pre(self.before - 1 - keyframe)
        } else if keyframe == self.before {
            Leg::ToActuation
        } else {
            Leg::Post(keyframe - self.before - 1)
        }
    }

    /// The leg along hand path number `path` in time.
    pub fn along(&self, path: usize) -> Leg {
        self.toward(path + 1)
    }

    /// The leg that ends at the actuation pose: the approach, where nothing lies before it.
    pub fn last_before_actuation(&self) -> Leg {
        self.toward(self.before)
    }

    /// The leg that begins at the actuation pose, where one does.
    pub fn first_after_actuation(&self) -> Option<Leg> {
        (self.after > 0).then_some(Leg::Post(0))
    }

    /// Number in time of the keyframe that a leg leads to.
    pub fn number(&self, leg: Leg) -> usize {
        match leg {
            Leg::Approach => 0,
            Leg::Pre(i) => self.before - 1 - i,
            Leg::ToActuation => self.before,
            Leg::Post(i) => self.before + 1 + i,
        }
    }

    /// All legs in time.
    pub fn legs(&self) -> impl Iterator<Item = Leg> + use<> {
        let course = *self;
        (0..self.len()).map(move |k| course.toward(k))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn legs_and_keyframes_are_numbered_alike() {
        for (before, after) in [(0, 0), (0, 2), (1, 1), (3, 2)] {
            let course = Course { before, after };
            for (k, leg) in course.legs().enumerate() {
                assert_eq!(course.number(leg), k, "{leg:?}");
            }
            assert_eq!(course.number(course.last_before_actuation()), before);
        }
    }

    #[test]
    fn pre_actuation_motions_count_from_the_actuation() {
        let course = Course { before: 3, after: 1 };
        let legs: Vec<Leg> = course.legs().collect();
        assert_eq!(legs, [Leg::Approach, Leg::Pre(1), Leg::Pre(0), Leg::ToActuation, Leg::Post(0)]);
    }
}
