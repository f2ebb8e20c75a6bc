//! RRT-Connect (Kuffner and LaValle, 2000) from one start to several goals at once. Samples come from a counter, so the
//! same problem gives the same path.
//!
//! Where an end lies in a narrow place, most long edges from it are blocked, and what leads out is short and goes few
//! ways: a thorough search keeps the beginning of a blocked edge where it is free, and draws half of its samples about
//! the tree. Where long edges will do, a plain one finds shorter ways.

use super::field::Field;
use crate::free_space::Draws;
use crate::model::{MAX_JOINTS, Row};

/// Longest edge that a tree grows by (weighted, m).
const EDGE: f64 = 0.6;
/// Share of the way that may be left after it where EDGE is all of it.
const NEARER: f64 = 0.98;
/// So much of a blocked edge is tried by itself.
const BEGINNING: f64 = 0.3;
/// Beginnings shorter than this (weighted, m) are not worth a node.
const SHORTEST: f64 = 0.03;
/// Share of the samples that are drawn about a node of the tree that grows, and how far from it each variable may be
/// (weighted, m).
const LOCAL: f64 = 0.5;
const SPREAD: f64 = 0.6;
/// Variables that move the robot less than this (m a unit) are drawn as if they moved it so much.
const LIGHTEST: f64 = 0.05;

/// Parameters of a search.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Manner {
    /// Whole edges, to samples drawn anywhere.
    Plain,
    /// Beginnings of blocked edges too, and samples about the trees.
    Thorough,
}

/// Configurations, each with its parent; roots are their own.
struct Tree {
    nodes: Vec<Row>,
    /// The nodes in the metric of the search, variable by variable.
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

    /// Configurations from a node back to its root.
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

/// Corners of a way from `start` to one of `goals`, both included, along edges that are free as far as they were looked
/// at; `None` where the samples are spent, or the search has to end.
pub(super) fn search(
    field: &mut Field<'_>,
    start: &Row,
    goals: &[Row],
    samples: usize,
    seed: usize,
    manner: Manner,
) -> Option<Vec<Row>> {
    // The straight ways first, the shortest before the others.
    let mut near: Vec<&Row> = goals.iter().collect();
    near.sort_by(|a, b| field.length(start, a).total_cmp(&field.length(start, b)));
    for goal in near {
        if field.is_edge_free(start, goal) {
            return Some(vec![*start, *goal]);
        }
        if field.is_over() {
            return None;
        }
    }
    let mut draws = Draws::of(0x7472_616e, seed);
    let mut trees = [Tree::of(field, &[*start]), Tree::of(field, goals)];
    let mut active = 0;
    for _ in 0..samples {
        if field.is_over() {
            return None;
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
                    return Some(path);
                }
            }
        }
        // The smaller tree grows: the harder end gets the more samples.
        active = usize::from(trees[1].nodes.len() < trees[0].nodes.len());
    }
    None
}

/// A configuration to grow towards: anywhere, or about a node of the tree.
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

/// Outcome of an edge.
enum Grown {
    /// It is free: its end.
    Whole(usize),
    /// It is blocked, but for its beginning, which ends there.
    Beginning(usize),
    Not,
}

/// Takes the end of an edge to where what holds all along holds; whether that can be done, and leaves it nearer to
/// `target` than the `length` that its start is away.
fn pulled(field: &mut Field<'_>, end: &mut Row, target: &Row, length: f64) -> bool {
    field.along.is_none() || (field.pull(end) && (end == target || field.length(end, target) <= NEARER * length))
}

/// Grows a tree one edge towards `target`.
fn grow(field: &mut Field<'_>, tree: &mut Tree, target: &Row, manner: Manner) -> Grown {
    let n = field.model.n();
    let from = tree.nearest(n, &scaled(field, target));
    let start = tree.nodes[from];
    let length = field.length(&start, target);
    if length == 0.0 {
        return Grown::Not;
    }
    let part = |share: f64| {
        let mut end = *target;
        for v in 0..n {
            end[v] = start[v] + (target[v] - start[v]) * share;
        }
        end
    };
    let long = length.min(EDGE);
    let mut end = if length > EDGE { part(EDGE / length) } else { *target };
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
    let mut end = part(BEGINNING * long / length);
    if pulled(field, &mut end, target, length) && field.is_edge_free(&start, &end) {
        tree.push(field, &end, from);
        return Grown::Beginning(tree.nodes.len() - 1);
    }
    Grown::Not
}
