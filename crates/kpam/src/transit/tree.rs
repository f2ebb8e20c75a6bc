//! RRT-Connect (Kuffner and LaValle, 2000) from one start to several goals at once. Samples come from a counter, so the
//! same problem gives the same path.
//!
//! If the start or a goal lies in a narrow space, most long edges are blocked and only a few short ones lead out. A
//! thorough search therefore keeps the free beginning of a blocked edge, and draws half of its samples around the tree.
//! A plain search finds shorter paths if long edges suffice.

use super::field::Field;
use crate::model::{MAX_JOINTS, Row, between};
use gensim2_geometry::Draws;

/// Maximum length (m) of an edge added to a tree; each variable is multiplied by its weight. An edge
/// of this length has eight checked configurations, which fit one batch.
const EDGE: f64 = 0.4;
/// If path constraints shorten an edge, at most this fraction of the distance to its target may remain.
const NEARER: f64 = 0.98;
/// Fraction of a blocked edge that is tried as a shorter edge.
const BEGINNING: f64 = 0.3;
/// Minimum length (m) of the free beginning of a blocked edge; each variable is multiplied by its weight.
const SHORTEST: f64 = 0.03;
/// Fraction of the samples that lie around a node of the growing tree, and their maximum distance (m) from it in each
/// variable multiplied by its weight.
const LOCAL: f64 = 0.5;
const SPREAD: f64 = 0.6;
/// Minimum weight (m per unit) of a variable that sampling assumes.
const LIGHTEST: f64 = 0.05;

/// Strategy of a search.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Manner {
    /// Adds only edges that are free over their whole length. Samples lie anywhere in the joint ranges.
    Plain,
    /// Also adds the free beginnings of blocked edges, and takes samples around the trees.
    Thorough,
}

/// A search tree of configurations. Each has the index of its parent; a root is its own parent.
struct Tree {
    nodes: Vec<Row>,
    /// The configurations, with each variable multiplied by its weight.
    scaled: Vec<Row>,
    parents: Vec<usize>,
}

impl Tree {
    fn of(field: &Field<'_>, roots: &[Row]) -> Self {
        let mut tree = Self { nodes: Vec::new(), scaled: Vec::new(), parents: Vec::new() };
        for root in roots {
            let own = tree.nodes.len();
            tree.push(field, root, own);
        }
        tree
    }

    fn push(&mut self, field: &Field<'_>, x: &Row, parent: usize) {
        self.nodes.push(*x);
        self.scaled.push(scaled(field, x));
        self.parents.push(parent);
    }

    fn nearest(&self, n: usize, at: &Row) -> usize {
        let mut best = (f64::INFINITY, 0);
        for (i, node) in self.scaled.iter().enumerate() {
            let mut d = 0.0;
            for v in 0..n {
                d += (node[v] - at[v]) * (node[v] - at[v]);
            }
            if d < best.0 {
                best = (d, i);
            }
        }
        best.1
    }

    /// Returns the configurations from a node back to its root.
    fn to_root(&self, mut at: usize) -> Vec<Row> {
        let mut out = vec![self.nodes[at]];
        while self.parents[at] != at {
            at = self.parents[at];
            out.push(self.nodes[at]);
        }
        out
    }
}

fn scaled(field: &Field<'_>, x: &Row) -> Row {
    let mut out = [0.0; MAX_JOINTS];
    for v in 0..field.model.n() {
        out[v] = x[v] * field.weights[v];
    }
    out
}

/// A search that found no path.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Unmet {
    /// Whether a thorough search added no configuration to the start.
    pub is_boxed_in: bool,
}

/// Returns the vertices of a path from `start` to one of `goals`, including both, along edges that are free as far as
/// checked.
///
/// # Errors
/// The samples are used up, or the search must end.
pub(super) fn search(
    field: &mut Field<'_>,
    start: &Row,
    goals: &[Row],
    samples: usize,
    seed: usize,
    manner: Manner,
) -> Result<Vec<Row>, Unmet> {
    // Try the straight edges to the goals first, the shortest one first.
    let mut near: Vec<&Row> = goals.iter().collect();
    near.sort_by(|a, b| field.length(start, a).total_cmp(&field.length(start, b)));
    for goal in near {
        if field.is_edge_free(start, goal) {
            return Ok(vec![*start, *goal]);
        }
        if field.is_over() {
            return Err(Unmet { is_boxed_in: false });
        }
    }
    let mut draws = Draws::of(0x7472_616e, seed);
    let mut trees = [Tree::of(field, &[*start]), Tree::of(field, goals)];
    let mut active = 0;
    for _ in 0..samples {
        if field.is_over() {
            return Err(Unmet { is_boxed_in: false });
        }
        let mut target = sample(field, &trees[active], &mut draws, manner);
        if !field.pull(&mut target) {
            continue;
        }
        if let Grown::Whole(new) | Grown::Beginning(new) = grow(field, &mut trees[active], &target, manner) {
            let meet = trees[active].nodes[new];
            let other = 1 - active;
            while let Grown::Whole(reached) = grow(field, &mut trees[other], &meet, manner) {
                if trees[other].nodes[reached] == meet {
                    let mut path = trees[active].to_root(new);
                    path.reverse();
                    path.extend(trees[other].to_root(reached).into_iter().skip(1));
                    if active == 1 {
                        path.reverse();
                    }
                    return Ok(path);
                }
            }
        }
        // The smaller tree grows, so that the harder end gets more samples.
        active = usize::from(trees[1].nodes.len() < trees[0].nodes.len());
    }
    Err(Unmet { is_boxed_in: manner == Manner::Thorough && trees[0].nodes.len() == 1 })
}

/// Returns a random configuration towards which the tree grows: anywhere, or around a node of the tree.
fn sample(field: &Field<'_>, tree: &Tree, draws: &mut Draws, manner: Manner) -> Row {
    let node = (manner == Manner::Thorough && draws.unit() < LOCAL).then(|| {
        let at = (draws.unit() * tree.nodes.len() as f64) as usize;
        tree.nodes[at.min(tree.nodes.len() - 1)]
    });
    let mut target = [0.0; MAX_JOINTS];
    for (v, value) in target.iter_mut().enumerate().take(field.model.n()) {
        let (low, high) = field.model.range(v);
        *value = match &node {
            None => low + (high - low) * draws.unit(),
            Some(node) => {
                let aside = (2.0 * draws.unit() - 1.0) * SPREAD / field.weights[v].max(LIGHTEST);
                (node[v] + aside).clamp(low, high)
            }
        };
    }
    target
}

/// Result of growing a tree by one edge.
enum Grown {
    /// The whole edge is free. Contains the index of the node at its end.
    Whole(usize),
    /// Only the beginning of the edge is free. Contains the index of the node at the end of this part.
    Beginning(usize),
    Not,
}

/// Moves the end of an edge so that it meets the path constraints. Returns whether this succeeds and the end is closer
/// to `target` than the start of the edge, whose distance is `length`.
fn pulled(field: &mut Field<'_>, end: &mut Row, target: &Row, length: f64) -> bool {
    field.along.is_none() || (field.pull(end) && (end == target || field.length(end, target) <= NEARER * length))
}

/// Grows a tree by one edge towards `target`.
fn grow(field: &mut Field<'_>, tree: &mut Tree, target: &Row, manner: Manner) -> Grown {
    let n = field.model.n();
    let from = tree.nearest(n, &scaled(field, target));
    let start = tree.nodes[from];
    let length = field.length(&start, target);
    if length == 0.0 {
        return Grown::Not;
    }
    let long = length.min(EDGE);
    let mut end = if length > EDGE { between(&start, target, EDGE / length) } else { *target };
    if !pulled(field, &mut end, target, length) {
        return Grown::Not;
    }
    if field.is_edge_free(&start, &end) {
        tree.push(field, &end, from);
        return Grown::Whole(tree.nodes.len() - 1);
    }
    if manner == Manner::Plain || BEGINNING * long < SHORTEST {
        return Grown::Not;
    }
    let mut end = between(&start, target, BEGINNING * long / length);
    if pulled(field, &mut end, target, length) && field.is_edge_free(&start, &end) {
        tree.push(field, &end, from);
        return Grown::Beginning(tree.nodes.len() - 1);
    }
    Grown::Not
}
