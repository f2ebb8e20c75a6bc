//! What a free joint vector says of its neighbours, and the clearance that is asked of pairs.

use crate::contact::TOUCH;
use crate::model::{MOST_JOINTS, Row};

/// A pair that leaves a gap.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Near {
    pub gap: f64,
    pub link: usize,
    /// The other link, or `None` for what stands still.
    pub other: Option<usize>,
}

/// Joint vectors about a free one that are free as well.
#[derive(Debug, Clone)]
pub(crate) struct Bubble {
    pub center: Row,
    pub n: usize,
    /// Largest distance of each link's points from each variable's axis.
    pub levers: Vec<Row>,
    pub pairs: Vec<Near>,
}

impl Default for Bubble {
    fn default() -> Self {
        Self { center: [0.0; MOST_JOINTS], n: 0, levers: Vec::new(), pairs: Vec::new() }
    }
}

impl Bubble {
    pub fn holds(&self, moves: &[Vec<bool>], x: &Row) -> bool {
        let mut step = [0.0; MOST_JOINTS];
        for v in 0..self.n {
            step[v] = x[v] - self.center[v];
        }
        self.pairs.iter().all(|p| self.used(moves, p, &step) <= p.gap)
    }

    /// How many times `step` one can go from the centre and stay inside.
    pub fn times(&self, moves: &[Vec<bool>], step: &Row) -> f64 {
        self.pairs.iter().map(|p| p.gap / self.used(moves, p, step)).fold(f64::INFINITY, f64::min)
    }

    /// What a step uses of a pair's gap, at most.
    fn used(&self, moves: &[Vec<bool>], p: &Near, step: &Row) -> f64 {
        let mut way = 0.0;
        let mut turn = 0.0;
        let mine = &self.levers[p.link];
        match p.other {
            None => {
                for v in 0..self.n {
                    way += step[v].abs() * mine[v];
                    turn += step[v].abs();
                }
            }
            Some(other) => {
                let theirs = &self.levers[other];
                for v in 0..self.n {
                    // A joint that carries both links does not move one against the other.
                    if !(moves[p.link][v] && moves[other][v]) {
                        way += step[v].abs() * mine[v].max(theirs[v]);
                        turn += step[v].abs();
                    }
                }
            }
        }
        way + turn * p.gap
    }

    /// Most that a point of the robot moves from `a` to `b`, to first order.
    pub fn fastest(&self, a: &Row, b: &Row) -> f64 {
        self.levers.iter().map(|l| (0..self.n).map(|v| l[v] * (b[v] - a[v]).abs()).sum::<f64>()).fold(0.0, f64::max)
    }
}

/// Clearance asked of judged pairs, and less where a pair cannot keep it.
#[derive(Debug, Clone)]
pub(crate) struct Margins {
    /// Whether overlaps of the start may persist.
    pub forgiving: bool,
    pub clearance: f64,
    pub bodies: Vec<((usize, usize), f64)>,
    pub pairs: Vec<(usize, f64)>,
}

impl Margins {
    pub fn plain(clearance: f64) -> Self {
        Self { forgiving: true, clearance, bodies: Vec::new(), pairs: Vec::new() }
    }

    /// The same margins after the overlaps of the start have come apart: they may not come back.
    pub fn parted(self) -> Self {
        Self { forgiving: false, ..self }
    }

    /// The same margins, all `by` smaller.
    pub fn eased(&self, by: f64) -> Self {
        let mut out = self.clone();
        out.clearance -= by.min(out.clearance);
        out.bodies.iter_mut().for_each(|(_, d)| *d = (*d - by).max(d.min(-TOUCH)));
        out.pairs.iter_mut().for_each(|(_, d)| *d = (*d - by).max(d.min(-TOUCH)));
        out
    }

    /// What is asked of a link and a body of the scene; `start` holds the overlaps at the start.
    pub fn body(&self, start: &[Vec<f64>], link: usize, body: usize) -> f64 {
        self.asked(&self.bodies, (link, body), start[link][body])
    }

    /// What is asked of a pair of links.
    pub fn itself(&self, start: &[f64], pair: usize) -> f64 {
        self.asked(&self.pairs, pair, start[pair])
    }

    /// Rounding is forgiven, and an overlap at the start may persist.
    fn asked<K: PartialEq + Copy>(&self, less: &[(K, f64)], key: K, start: f64) -> f64 {
        let asked = less.iter().filter(|(k, _)| *k == key).fold(self.clearance - TOUCH, |least, (_, d)| least.min(*d));
        if start < 0.0 && self.forgiving { asked.min(start - TOUCH) } else { asked }
    }
}
