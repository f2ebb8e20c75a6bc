//! Distance bounds of the collision screen (a fast check before exact distances) are conservative.

#![allow(clippy::unwrap_used)]

use gensim2_geometry::{
    Batch, Convex, Corners, Cover, Joint, LANES, Link, Needs, Other, Pose, Riders, Robot, Screen, VoxelGrid,
    signed_distance,
};
use nalgebra::{Point3, Rotation3, Vector3};
use proptest::prelude::*;

fn hull(rough: &[[f64; 3]]) -> Convex {
    Convex::hull(&rough.iter().map(|p| Point3::from(*p)).collect::<Vec<_>>()).unwrap()
}

fn pose(at: [f64; 3], turn: [f64; 3]) -> Pose {
    Pose::from_parts(Vector3::from(at).into(), Rotation3::new(Vector3::from(turn)))
}

/// Three links: two boxes and a ball on the base, an irregular hull, and two capsules.
fn arm(rough: &[[f64; 3]]) -> Robot {
    let cuboid = Convex::cuboid([0.06, 0.05, 0.15], &pose([0.0, 0.0, 0.15], [0.1, 0.0, 0.0])).unwrap();
    let rod = Convex::capsule(0.03, 0.2, &pose([0.1, 0.0, 0.0], [0.0, 1.2, 0.0])).unwrap();
    let upper = Convex::cuboid([0.1, 0.02, 0.03], &pose([0.05, 0.0, 0.38], [0.0, 0.0, 0.4])).unwrap();
    let knob = Convex::ball(0.04, Point3::new(-0.1, 0.1, 0.2)).unwrap();
    let cross = Convex::capsule(0.02, 0.1, &pose([0.25, 0.05, 0.0], [1.0, 0.0, 0.3])).unwrap();
    Robot::builder("arm")
        .link(Link::base("base"))
        .link(
            Link::below("base", "one")
                .moved_by(Joint::revolute("a", Vector3::z()).limits(-3.0, 3.0).velocity(1.0))
                .shape(cuboid)
                .shape(upper)
                .shape(knob),
        )
        .link(
            Link::below("one", "two")
                .at(pose([0.0, 0.0, 0.4], [0.3, 0.2, 0.0]))
                .moved_by(Joint::revolute("b", Vector3::new(0.3, 1.0, 0.2)).limits(-3.0, 3.0).velocity(1.0))
                .shape(hull(rough)),
        )
        .link(
            Link::below("two", "three")
                .at(pose([0.3, 0.0, 0.1], [0.0, 0.4, 0.0]))
                .moved_by(Joint::prismatic("c", Vector3::x()).limits(-0.2, 0.2).velocity(1.0))
                .shape(rod)
                .shape(cross),
        )
        .build("three")
        .unwrap()
}

fn brute(a: &Convex, at: &Pose, b: &Convex) -> f64 {
    let moved = a.moved(at);
    let (p, q) = (Corners::of(moved.points()), Corners::of(b.points()));
    signed_distance((&p, moved.radius()), (&q, b.radius()), &mut (b.center() - moved.center()), 1e5).unwrap().distance
}

/// Distance between shapes at a pose and other shapes, by measuring every pair.
fn least(own: &[Convex], at: &Pose, others: &[Convex]) -> f64 {
    own.iter().flat_map(|a| others.iter().map(|b| brute(a, at, b))).fold(f64::INFINITY, f64::min)
}

fn coordinates(reach: f64) -> impl Strategy<Value = [f64; 3]> {
    prop::array::uniform3(-reach..reach)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn bounds_are_never_above_distances(
        rough in prop::collection::vec(coordinates(0.12), 5..30),
        q in prop::collection::vec((-3.0..3.0f64, -30.0..30.0f64, -0.2..0.2f64), LANES),
        places in prop::collection::vec((coordinates(0.9), coordinates(3.0)), 6),
        loose in prop::collection::vec(coordinates(0.2), 5..40),
        cloud in prop::collection::vec(coordinates(0.8), 40..200),
        strays in prop::collection::vec((coordinates(1.0), 0.0..3.0f64), 0..4),
    ) {
        let robot = arm(&rough);
        let at: Vec<Pose> = places.iter().map(|(t, r)| pose(*t, *r)).collect();
        let none = Pose::identity();
        let far = strays.iter().map(|(p, decades)| p.map(|x| x * 10f64.powf(*decades)));
        let balls: Vec<Convex> =
            cloud.iter().copied().chain(far).map(|p| Convex::ball(0.01, Point3::from(p)).unwrap()).collect();
        let bodies: Vec<(Vec<Convex>, Pose)> = vec![
            (vec![Convex::cuboid([0.3, 0.1, 0.02], &none).unwrap()], at[0]),
            (vec![Convex::cylinder(0.05, 0.3, &none).unwrap()], at[1]),
            (vec![Convex::capsule(0.05, 0.3, &none).unwrap()], at[2]),
            (vec![Convex::ball(0.1, Point3::origin()).unwrap(), hull(&loose)], at[3]),
            (vec![hull(&loose[..3])], at[4]),
            (balls, at[5]),
        ];
        let groups: Vec<Riders<'_>> = (0..4).map(|link| Riders { link, held: None }).collect();
        let pairs = vec![(1, 3)];
        let screen =
            Screen::new(&robot, &Cover::of(&robot), &groups, pairs, bodies.iter().map(|(s, p)| (s.as_slice(), p)));
        let mut batch = Batch::default();
        for (lane, (a, b, c)) in q.iter().enumerate() {
            batch.set(&screen, lane, &[*a, *b, *c]);
        }
        screen.place(&mut batch);
        let needs = Needs { bodies: vec![0.01; 4 * bodies.len()], pairs: vec![0.02] };
        let reach = 0.1_f32;
        let mut said = vec![vec![[f64::from(reach); LANES]; bodies.len() + 1]; 4];
        let mut most = vec![vec![[f64::INFINITY; LANES]; bodies.len() + 1]; 4];
        screen.survey(&mut batch, &needs, reach, |s| {
            let body = screen.body(s.other).unwrap_or(bodies.len());
            for lane in 0..LANES {
                let least = &mut said[s.group][body][lane];
                *least = least.min(f64::from(s.gap[lane]));
                let upper = &mut most[s.group][body][lane];
                *upper = upper.min(f64::from(s.max_gap[lane]));
            }
            true
        });
        // A survey leaves out the pairs that were looked at alone since the last placement, and only these.
        let listed = |batch: &mut Batch| {
            let mut found = Vec::new();
            screen.survey(batch, &needs, reach, |s| {
                found.push((s.group, s.other));
                true
            });
            found
        };
        let whole = listed(&mut batch);
        for alone in whole.iter().copied().take(3) {
            screen.place(&mut batch);
            screen.look_at(&mut batch, &needs, alone, 0.0, |_| true);
            let rest: Vec<_> = whole.iter().copied().filter(|pair| *pair != alone).collect();
            prop_assert_eq!(listed(&mut batch), rest);
        }
        screen.place(&mut batch);
        prop_assert_eq!(listed(&mut batch), whole);
        let mut poses = Vec::new();
        for (lane, (a, b, c)) in q.iter().enumerate() {
            robot.link_poses(&[*a, *b, *c], &mut poses).unwrap();
            let mut elements = 0;
            for (body, (shapes, stands)) in bodies.iter().enumerate() {
                for group in 1..4 {
                    let placed: Vec<Convex> = shapes.iter().map(|s| s.moved(stands)).collect();
                    let wanted = least(robot.links()[group].shapes(), &poses[group], &placed);
                    // For overlapping bodies only the missing clearance is reported.
                    prop_assert!(said[group][body][lane] <= wanted.max(0.0) - 0.01 + 1e-9, "{body} {group}");
                    // Bodies reported as surely too close are too close.
                    prop_assert!(most[group][body][lane] >= 0.0 || wanted < 0.01, "{body} {group} {wanted}");
                    prop_assert!(wanted < 0.0 || most[group][body][lane] >= wanted - 0.01 - 1e-9, "{body} {wanted}");
                    // Exact measurement of single pairs agrees with brute force.
                    for keep in [0.0, 0.01, 0.05] {
                        let others: Vec<Other> = if body == 5 {
                            (0..2).map(Other::Cloud).filter(|cloud| screen.body(*cloud) == Some(5)).collect()
                        } else {
                            (elements..elements + shapes.len()).map(Other::Element).collect()
                        };
                        let kept = others.iter().all(|o| screen.keeps(group, *o, &poses, keep));
                        prop_assert!(kept == (wanted >= keep) || (wanted - keep).abs() < 1e-6, "{body} {wanted} {keep}");
                        let far = others.iter().map(|o| screen.distance(group, *o, &poses, keep));
                        let far = far.fold(f64::INFINITY, f64::min);
                        prop_assert!(wanted < 0.0 || (far - wanted.min(keep)).abs() < 1e-6, "{body} {far} {wanted}");
                    }
                }
                if body != 5 {
                    elements += shapes.len();
                }
            }
            let two: Vec<Convex> = robot.links()[3].shapes().iter().map(|s| s.moved(&poses[3])).collect();
            let wanted = least(robot.links()[1].shapes(), &poses[1], &two);
            prop_assert!(said[1][bodies.len()][lane] <= wanted.max(0.0) - 0.02 + 1e-9);
            prop_assert!(most[1][bodies.len()][lane] >= 0.0 || wanted < 0.02);
            prop_assert!(screen.keeps(1, Other::Pair(0), &poses, 0.01) == (wanted >= 0.01));
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]
    #[test]
    fn bounds_and_distances_of_voxels_are_those_of_their_boxes(
        rough in prop::collection::vec(coordinates(0.12), 5..30),
        q in prop::collection::vec((-3.0..3.0f64, -3.0..3.0f64, -0.2..0.2f64), LANES),
        place in (coordinates(0.5), coordinates(3.0)),
        (size, share, slab) in (0.02..0.09f64, 0.02..0.6f64, 0..9usize),
        seed in any::<u32>(),
    ) {
        let robot = arm(&rough);
        let stands = pose(place.0, place.1);
        // Loose voxels and a solid slab, so that there are cubes of several sizes.
        let grid = VoxelGrid::new([9, 8, 9], size, Point3::from([-4.5 * size; 3])).unwrap();
        let mut state = u64::from(seed);
        let occupied: Vec<bool> = (0..grid.count())
            .map(|i| {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                i % 9 < slab || (state >> 33) as f64 / f64::from(1_u32 << 31) < share
            })
            .collect();
        let solids = grid.solids(&occupied).unwrap();
        let voxels: Vec<Convex> = (0..grid.count())
            .filter(|i| occupied[*i])
            .map(|i| {
                let at = [i / 72, i / 9 % 8, i % 9].map(|v| size * (v as f64 + 0.5 - 4.5));
                Convex::cuboid([0.5 * size; 3], &pose(at, [0.0; 3])).unwrap().moved(&stands)
            })
            .collect();
        let groups: Vec<Riders<'_>> = (0..4).map(|link| Riders { link, held: None }).collect();
        let screen = Screen::new(&robot, &Cover::of(&robot), &groups, Vec::new(), [(solids.as_slice(), &stands)]);
        let mut batch = Batch::default();
        for (lane, (a, b, c)) in q.iter().enumerate() {
            batch.set(&screen, lane, &[*a, *b, *c]);
        }
        screen.place(&mut batch);
        let needs = Needs { bodies: vec![0.01; 4], pairs: Vec::new() };
        let mut said = [[0.1_f64; LANES]; 4];
        let mut most = [[f64::INFINITY; LANES]; 4];
        let mut others = Vec::new();
        screen.survey(&mut batch, &needs, 0.1, |s| {
            for lane in 0..LANES {
                said[s.group][lane] = said[s.group][lane].min(f64::from(s.gap[lane]));
                most[s.group][lane] = most[s.group][lane].min(f64::from(s.max_gap[lane]));
            }
            if !others.contains(&s.other) {
                others.push(s.other);
            }
            true
        });
        let mut poses = Vec::new();
        for (lane, (a, b, c)) in q.iter().enumerate() {
            robot.link_poses(&[*a, *b, *c], &mut poses).unwrap();
            for group in 1..4 {
                let wanted = least(robot.links()[group].shapes(), &poses[group], &voxels);
                prop_assert!(said[group][lane] <= wanted.max(0.0) - 0.01 + 1e-9, "{group} {wanted}");
                prop_assert!(most[group][lane] >= 0.0 || wanted < 0.01, "{group} {wanted}");
                prop_assert!(wanted < 0.0 || most[group][lane] >= wanted - 0.01 - 1e-9, "{wanted}");
                for keep in [0.0, 0.01, 0.05] {
                    let kept = others.iter().all(|o| screen.keeps(group, *o, &poses, keep));
                    prop_assert!(kept == (wanted >= keep) || (wanted - keep).abs() < 1e-6, "{wanted} {keep}");
                    let far = others.iter().map(|o| screen.distance(group, *o, &poses, keep)).fold(keep, f64::min);
                    prop_assert!(wanted < 1e-6 || (far - wanted.min(keep)).abs() < 1e-6, "{far} {wanted}");
                    // The depth in a merged cube is at least the depth in its deepest voxel.
                    prop_assert!(wanted >= 0.0 || far <= wanted + 1e-6, "{far} {wanted}");
                }
            }
        }
    }
}

#[test]
fn what_lies_in_the_middle_of_another_is_surely_too_near() {
    let robot = arm(&[[0.1, 0.1, 0.1], [-0.1, 0.1, -0.1], [0.1, -0.1, -0.1], [-0.1, -0.1, 0.1], [0.1, 0.1, -0.1]]);
    let none = Pose::identity();
    let cuboid = [Convex::cuboid([0.2; 3], &none).unwrap()];
    let cylinder = [Convex::cylinder(0.2, 0.4, &none).unwrap()];
    let places = [pose([0.0, 0.0, 0.15], [0.0; 3]), pose([0.0, 0.0, 0.2], [0.3, 0.0, 0.0])];
    let bodies = [(&cuboid[..], &places[0]), (&cylinder[..], &places[1])];
    let groups: Vec<Riders<'_>> = (0..4).map(|link| Riders { link, held: None }).collect();
    let screen = Screen::new(&robot, &Cover::of(&robot), &groups, Vec::new(), bodies);
    let mut batch = Batch::default();
    (0..LANES).for_each(|lane| batch.set(&screen, lane, &[0.0, 0.0, 0.0]));
    screen.place(&mut batch);
    let needs = Needs { bodies: vec![0.0; 8], pairs: Vec::new() };
    let mut sure = [false; 2];
    screen.survey(&mut batch, &needs, 0.0, |s| {
        if let (1, Some(body)) = (s.group, screen.body(s.other)) {
            sure[body] |= s.max_gap.iter().all(|m| *m < 0.0);
        }
        true
    });
    assert_eq!(sure, [true, true]);
}

#[test]
fn values_of_single_joints_place_the_robot_like_whole_configurations() {
    let robot = arm(&[[0.1, 0.1, 0.1], [-0.1, 0.1, -0.1], [0.1, -0.1, -0.1], [-0.1, -0.1, 0.1], [0.1, 0.1, -0.1]]);
    let groups: Vec<Riders<'_>> = (0..4).map(|link| Riders { link, held: None }).collect();
    let screen = Screen::new(&robot, &Cover::of(&robot), &groups, Vec::new(), []);
    let corners = |batch: &mut Batch| {
        screen.place(batch);
        let mut out = Vec::new();
        screen.corners(batch, |_, _, place| out.push(place));
        out
    };
    let (mut whole, mut single) = (Batch::default(), Batch::default());
    (0..LANES).for_each(|lane| single.set(&screen, lane, &[0.3, 0.2, 0.1]));
    for k in 0..50 {
        let value = |lane: usize, joint: usize| {
            let share = (f64::from(k) * 0.618 + lane as f64 * 0.414 + joint as f64 * 0.732).fract();
            [-3.0 + 6.0 * share, -30.0 + 60.0 * share, -0.2 + 0.4 * share][joint]
        };
        for lane in 0..LANES {
            whole.set(&screen, lane, &[value(lane, 0), value(lane, 1), value(lane, 2)]);
        }
        for joint in 0..3 {
            single.set_joint(&screen, joint, std::array::from_fn(|lane| value(lane, joint)));
        }
        assert_eq!(corners(&mut whole), corners(&mut single));
    }
}
