//! Pairs within reach, compared with the analytic distances of spheres, with and without early exit.

#![allow(clippy::unwrap_used)]

use std::collections::BTreeMap;

use gensim2_geometry::{Convex, MovingShapes, Obstacles, Pose, Scratch, Target};
use nalgebra::Point3;
use proptest::prelude::*;

/// Center and radius.
type Ball = ([f64; 3], f64);

fn groups_of_balls() -> impl Strategy<Value = Vec<Vec<Ball>>> {
    let ball = (prop::array::uniform3(-0.6..0.6f64), 0.02..0.15f64);
    prop::collection::vec(prop::collection::vec(ball, 0..4), 1..4)
}

fn shapes(groups: &[Vec<Ball>]) -> Vec<Vec<Convex>> {
    let ball = |(at, radius): &Ball| Convex::ball(*radius, Point3::from(*at)).unwrap();
    groups.iter().map(|g| g.iter().map(ball).collect()).collect()
}

/// Returns the distance of two groups; infinity if a group is empty.
fn apart(a: &[Ball], b: &[Ball]) -> f64 {
    let pairs = a.iter().flat_map(|p| b.iter().map(move |q| (p, q)));
    pairs.map(|((p, r), (q, s))| (Point3::from(*p) - Point3::from(*q)).norm() - r - s).fold(f64::INFINITY, f64::min)
}

/// Places the groups at the positions of their spheres.
fn placed(moving: &MovingShapes<'_>, early_exit: bool) -> Scratch {
    let all: Vec<usize> = (0..moving.len()).collect();
    let mut scratch = Scratch::remembering();
    scratch.set_early_exit(early_exit);
    moving.place(&all, &mut scratch, |poses| *poses = vec![Pose::identity(); moving.len()]);
    scratch
}

/// Returns the reported distances of groups and bodies.
fn near_bodies(
    moving: &MovingShapes<'_>,
    still: &Obstacles,
    reach: f64,
    early_exit: bool,
) -> BTreeMap<(usize, usize), f64> {
    let all: Vec<usize> = (0..moving.len()).collect();
    let mut seen = BTreeMap::new();
    moving.near_bodies(
        &all,
        still,
        &mut placed(moving, early_exit),
        f64::INFINITY,
        |_, _| reach,
        |near| {
            let body = (0..still.len()).find(|body| near.target == Target::Body(*body)).unwrap();
            assert!(seen.insert((near.group, body), near.contact.distance).is_none(), "visited twice");
            true
        },
    );
    seen
}

/// Returns the reported distances of pairs of groups, by index of the pair.
fn near_pairs(
    moving: &MovingShapes<'_>,
    pairs: &[(usize, usize)],
    reach: f64,
    early_exit: bool,
) -> BTreeMap<usize, f64> {
    let every: Vec<usize> = (0..pairs.len()).collect();
    let mut seen = BTreeMap::new();
    moving.near_pairs(
        pairs,
        &every,
        &mut placed(moving, early_exit),
        f64::INFINITY,
        |_| reach,
        |pair, near| {
            assert!(seen.insert(pair, near.contact.distance).is_none(), "visited twice");
            true
        },
    );
    seen
}

proptest! {
    #[test]
    fn of_bodies_the_nearest_are_told_and_in_haste_any(
        groups in groups_of_balls(), bodies in groups_of_balls(), reach in 0.0..0.3f64,
    ) {
        let (mine, theirs, origin) = (shapes(&groups), shapes(&bodies), Pose::identity());
        let moving = MovingShapes::new(mine.iter().map(Vec::as_slice));
        let still = Obstacles::new(theirs.iter().map(|s| (s.as_slice(), &origin)));
        let (all, early_exit) = (near_bodies(&moving, &still, reach, false), near_bodies(&moving, &still, reach, true));
        for (g, group) in groups.iter().enumerate() {
            let mut any = false;
            for (b, body) in bodies.iter().enumerate() {
                let truth = apart(group, body);
                prop_assume!((truth - reach).abs() > 1e-6);
                any |= truth < reach;
                prop_assert_eq!(all.contains_key(&(g, b)), truth < reach);
                if let Some(told) = all.get(&(g, b)) {
                    prop_assert!((told - truth).abs() < 1e-7, "{told} is told, {truth} is true");
                }
                if let Some(told) = early_exit.get(&(g, b)) {
                    prop_assert!((truth - 1e-7..reach).contains(told), "{told} is told, {truth} is true");
                }
            }
            prop_assert_eq!(early_exit.keys().any(|(group, _)| *group == g), any);
        }
    }

    #[test]
    fn of_pairs_the_nearest_are_told_and_in_haste_any(groups in groups_of_balls(), reach in 0.0..0.3f64) {
        let mine = shapes(&groups);
        let moving = MovingShapes::new(mine.iter().map(Vec::as_slice));
        let pairs: Vec<(usize, usize)> = (0..groups.len()).flat_map(|a| (0..a).map(move |b| (b, a))).collect();
        let (all, early_exit) = (near_pairs(&moving, &pairs, reach, false), near_pairs(&moving, &pairs, reach, true));
        for (number, &(a, b)) in pairs.iter().enumerate() {
            let truth = apart(&groups[a], &groups[b]);
            prop_assume!((truth - reach).abs() > 1e-6);
            prop_assert_eq!(all.contains_key(&number), truth < reach);
            prop_assert_eq!(early_exit.contains_key(&number), truth < reach);
            if let (Some(told), Some(quick)) = (all.get(&number), early_exit.get(&number)) {
                prop_assert!((told - truth).abs() < 1e-7, "{told} is told, {truth} is true");
                prop_assert!((truth - 1e-7..reach).contains(quick), "{quick} is told, {truth} is true");
            }
        }
    }
}
