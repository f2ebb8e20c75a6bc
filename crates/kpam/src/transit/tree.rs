//! RRT-Connect (Kuffner and LaValle, 2000) from one start to several goals at once. Samples come from a counter, so the
//! same problem gives the same path.

use super::field::Field;
use crate::free_space::Draws;
use crate::model::{MOST_JOINTS, Row};

/// Longest edge that a tree grows by (weighted, m).
const EDGE: f64 = 0.6;
/// Share of the way that may be left after it where EDGE is all of it.
const NEARER: f64 = 0.98;

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
    let mut out = [0.0; MOST_JOINTS];
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
) -> Option<Vec<Row>> {
    let n = field.model.n();
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
        let mut target = [0.0; MOST_JOINTS];
        for (v, value) in target.iter_mut().enumerate().take(n) {
            let (low, high) = field.model.range(v);
            *value = low + (high - low) * draws.unit();
        }
        if !field.pull(&mut target) {
            continue;
        }
        if let Some(new) = grow(field, &mut trees[active], &target) {
            let meet = trees[active].nodes[new];
            let other = 1 - active;
            while let Some(reached) = grow(field, &mut trees[other], &meet) {
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

/// Grows a tree one edge towards `target`; the new node, or `None` where it is blocked.
fn grow(field: &mut Field<'_>, tree: &mut Tree, target: &Row) -> Option<usize> {
    let from = tree.nearest(field.model.n(), &scaled(field, target));
    let start = tree.nodes[from];
    let length = field.length(&start, target);
    if length == 0.0 {
        return None;
    }
    let mut end = *target;
    if length > EDGE {
        for v in 0..field.model.n() {
            end[v] = start[v] + (target[v] - start[v]) * (EDGE / length);
        }
    }
    // What is pulled back has to have come nearer all the same.
    let nearer = |field: &Field<'_>, end: &Row| field.length(end, target) <= NEARER * length;
    if field.along.is_some() && !(field.pull(&mut end) && (end == *target || nearer(field, &end))) {
        return None;
    }
    if !field.is_edge_free(&start, &end) {
        return None;
    }
    tree.push(field, &end, from);
    Some(tree.nodes.len() - 1)
}
