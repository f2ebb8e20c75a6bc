//! The motion whose safety is proven: one step and the stop after it, and eight of its states.

use gensim2_geometry::LANES;

use super::joint::{Course, Reversals};
use crate::model::{MAX_JOINTS, Row};

/// The courses of all variables, with the range of positions of each.
pub(super) struct Motion<'m> {
    pub courses: &'m [Course],
    reversals: [Reversals; MAX_JOINTS],
    pub lower: Row,
    pub upper: Row,
    /// Time (s) after which the arm rests.
    pub end: f64,
}

impl<'m> Motion<'m> {
    pub fn new(courses: &'m [Course]) -> Self {
        let (mut reversals, mut end) = ([Reversals::default(); MAX_JOINTS], 0.0_f64);
        let [mut lower, mut upper] = [[0.0; MAX_JOINTS]; 2];
        for (v, course) in courses.iter().enumerate() {
            reversals[v] = course.reversals();
            (lower[v], upper[v]) = course.positions(&reversals[v]);
            end = end.max(course.duration());
        }
        Self { courses, reversals, lower, upper, end }
    }

    /// Returns eight times (s) from the start to rest. At an even deceleration, they divide the way evenly.
    pub fn times(&self) -> [f64; LANES] {
        std::array::from_fn(|lane| self.end * (1.0 - (1.0 - lane as f64 / (LANES - 1) as f64).sqrt()))
    }
}

/// Eight states of a motion. Arrays over intervals have an entry for each pair of neighbouring states; the last entry is
/// unused.
#[derive(Debug, Default)]
pub(super) struct Samples {
    /// Length (s) of each interval.
    pub lengths: [f32; LANES],
    pub rows: [Row; LANES],
    /// Total movement of each variable in each interval.
    pub travel: [[f32; LANES]; MAX_JOINTS],
    /// Upper bounds on the speed and the acceleration of each variable in each interval.
    pub speed: [[f32; LANES]; MAX_JOINTS],
    pub acceleration: [[f32; LANES]; MAX_JOINTS],
}

impl Samples {
    /// Samples a motion at ascending times (s).
    pub fn take(&mut self, motion: &Motion<'_>, times: &[f64; LANES]) {
        for lane in 0..LANES - 1 {
            self.lengths[lane] = (times[lane + 1] - times[lane]) as f32;
        }
        for (v, course) in motion.courses.iter().enumerate() {
            let states = times.map(|t| course.at(t));
            for (row, state) in self.rows.iter_mut().zip(&states) {
                row[v] = state[0];
            }
            for lane in 0..LANES - 1 {
                let ends = [lane, lane + 1].map(|lane| (times[lane], states[lane][0]));
                let gain = course.acceleration(times[lane], times[lane + 1]);
                let gain = gain.max(states[lane][2].abs()).max(states[lane + 1][2].abs());
                // The speed is greatest at an end, or exceeds one of the ends by the gain over half the interval.
                let speed = states[lane][1].abs().max(states[lane + 1][1].abs());
                let speed = speed + 0.5 * gain * (times[lane + 1] - times[lane]);
                self.travel[v][lane] = motion.reversals[v].travel(ends[0], ends[1]) as f32;
                (self.speed[v][lane], self.acceleration[v][lane]) = (speed as f32, gain as f32);
            }
        }
    }

    /// Returns times (s) that divide the interval between two times evenly.
    pub fn between(from: f64, to: f64) -> [f64; LANES] {
        std::array::from_fn(|k| from + (to - from) * k as f64 / (LANES - 1) as f64)
    }
}
