//! Distance bounds of the collision screen (a fast check before exact distances) are conservative.

#![allow(clippy::unwrap_used)]

use gensim2_geometry::{
    Batch, BodyJoint, Chains, Convex, Corners, Cover, Draws, Joint, JointKind, LANES, Link, Motions, Needs, Other,
    Pose, Riders, Robot, Screen, Travel, VoxelGrid, screw_about, signed_distance,
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
                        let kept = others.iter().all(|o| screen.keeps(group, *o, &poses, keep, &mut Vector3::zeros()));
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
            prop_assert!(screen.keeps(1, Other::Pair(0), &poses, 0.01, &mut Vector3::zeros()) == (wanted >= 0.01));
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
                    let kept = others.iter().all(|o| screen.keeps(group, *o, &poses, keep, &mut Vector3::zeros()));
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
    let (ball, none) = ([Convex::ball(0.1, Point3::new(0.3, 0.4, 0.5)).unwrap()], Pose::identity());
    let screen = Screen::new(&robot, &Cover::of(&robot), &groups, Vec::new(), [(&ball[..], &none)]);
    let needs = Needs { bodies: vec![0.0; 4], pairs: Vec::new() };
    let gaps = |batch: &mut Batch| {
        screen.place(batch);
        let mut out = Vec::new();
        screen.survey(batch, &needs, 10.0, |s| {
            out.push(s.gap);
            true
        });
        assert_eq!(out.len(), 3);
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
        assert_eq!(gaps(&mut whole), gaps(&mut single));
    }
}

/// Joints that move each link of [`arm`], each with the link that the joint moves.
fn carriers() -> Vec<Vec<(usize, usize)>> {
    (0..4).map(|link| (0..link).map(|joint| (joint, joint + 1)).collect()).collect()
}

/// A motion of [`arm`] between two configurations. It deviates from the straight line by a parabola.
struct Arc {
    from: [f64; 3],
    change: [f64; 3],
    off: [f64; 3],
}

impl Arc {
    fn at(&self, share: f64) -> [f64; 3] {
        [0, 1, 2].map(|j| self.from[j] + self.change[j] * share + 4.0 * self.off[j] * share * (1.0 - share))
    }

    fn travel(&self) -> [Travel; 3] {
        [0, 1, 2].map(|j| {
            let (apart, off) = (self.change[j].abs() as f32, self.off[j].abs() as f32);
            Travel { apart, gone: apart.max(4.0 * off), off }
        })
    }

    fn of(draws: &mut Draws) -> Self {
        let mut around = |most: [f64; 3]| most.map(|most| most * (2.0 * draws.unit() - 1.0));
        Self { from: around([3.0, 3.0, 0.2]), change: around([0.2, 0.3, 0.1]), off: around([0.01, 0.02, 0.01]) }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(96))]
    #[test]
    fn motions_keep_the_distances_that_are_proven(
        rough in prop::collection::vec(coordinates(0.12), 5..30),
        seed in 0..10_000usize,
        places in prop::collection::vec((coordinates(0.7), coordinates(3.0)), 5),
        loose in prop::collection::vec(coordinates(0.2), 5..40),
        cloud in prop::collection::vec(coordinates(0.6), 40..80),
        guess in coordinates(1.0),
    ) {
        const STEPS: usize = 8;
        let robot = arm(&rough);
        let at: Vec<Pose> = places.iter().map(|(t, r)| pose(*t, *r)).collect();
        let none = Pose::identity();
        let balls: Vec<Convex> = cloud.iter().map(|p| Convex::ball(0.01, Point3::from(*p)).unwrap()).collect();
        let bodies: Vec<(Vec<Convex>, Pose)> = vec![
            (vec![Convex::cuboid([0.3, 0.1, 0.02], &none).unwrap()], at[0]),
            (vec![Convex::cylinder(0.05, 0.3, &none).unwrap()], at[1]),
            (vec![Convex::capsule(0.05, 0.3, &none).unwrap()], at[2]),
            (vec![Convex::ball(0.1, Point3::origin()).unwrap(), hull(&loose)], at[3]),
            (balls, at[4]),
        ];
        let groups: Vec<Riders<'_>> = (0..4).map(|link| Riders { link, held: None }).collect();
        let shapes = bodies.iter().map(|(s, p)| (s.as_slice(), p));
        let screen = Screen::new(&robot, &Cover::of(&robot), &groups, vec![(1, 3), (3, 2)], shapes);
        let mut draws = Draws::of(3, seed);
        let arcs: Vec<Arc> = (0..LANES).map(|_| Arc::of(&mut draws)).collect();
        let mut motions = Motions::new(Chains::new(&robot, &screen, &carriers()));
        for (lane, arc) in arcs.iter().enumerate() {
            motions.set(&screen, lane, [&arc.at(0.0), &arc.at(1.0)], &arc.travel());
        }
        screen.place_between(&mut motions);
        let needs = Needs { bodies: vec![0.01; 4 * bodies.len()], pairs: vec![0.02; 2] };
        let mut suspects: Vec<(usize, Other, [f32; LANES])> = Vec::new();
        screen.survey_between(&mut motions, &needs, |s| {
            suspects.push((s.group, s.other, s.gap));
            true
        });
        // A pair that is looked at alone has the same gaps.
        for (group, other, gap) in &suspects {
            let mut alone = None;
            screen.look_between(&mut motions, &needs, (*group, *other), |s| {
                alone = Some(s.gap);
                true
            });
            prop_assert_eq!(alone, Some(*gap));
        }
        let link_poses = |q: [f64; 3]| {
            let mut poses = Vec::new();
            robot.link_poses(&q, &mut poses).unwrap();
            poses
        };
        let moved: Vec<(Vec<Convex>, &Pose)> =
            bodies.iter().map(|(shapes, at)| (shapes.iter().map(|s| s.moved(at)).collect(), at)).collect();
        for (lane, arc) in arcs.iter().enumerate() {
            let ends = [link_poses(arc.at(0.0)), link_poses(arc.at(1.0))];
            let ends = [ends[0].as_slice(), ends[1].as_slice()];
            let steps: Vec<Vec<Pose>> =
                (0..=STEPS).map(|k| link_poses(arc.at(k as f64 / STEPS as f64))).collect();
            // Groups and bodies.
            for group in 1..4 {
                for (body, (shapes, _)) in moved.iter().enumerate() {
                    let own = robot.links()[group].shapes();
                    let all = steps.iter().map(|poses| least(own, &poses[group], shapes));
                    let wanted = all.fold(f64::INFINITY, f64::min);
                    let of_body: Vec<_> =
                        suspects.iter().filter(|s| s.0 == group && screen.body(s.1) == Some(body)).collect();
                    let gap = of_body.iter().map(|s| f64::from(s.2[lane])).fold(0.0, f64::min);
                    prop_assert!(gap <= 0.0_f64.min(wanted.max(0.0) - 0.01) + 1e-9, "{group} {body} {gap} {wanted}");
                    let mut proven = true;
                    for (_, other, _) in of_body {
                        let bend = motions.bend(group, *other, lane);
                        let mut toward = Vector3::from(guess);
                        // The second time, the normal of the first time is the guess.
                        let [first, second] =
                            [0, 1].map(|_| screen.keeps_between(group, *other, ends, 0.01 + bend, &mut toward));
                        prop_assert_eq!(first, second);
                        proven &= first;
                        let way = screen.way_between(group, *other, ends);
                        let room = screen.distance(group, *other, ends[0], 1.0) - way - bend;
                        prop_assert!(first || room <= 0.01 + 1e-6, "{room}");
                    }
                    prop_assert!(!proven || wanted >= 0.01 - 1e-9, "{group} {body} {wanted}");
                }
            }
            // Pairs of groups.
            for (pair, (a, b)) in [(1, 3), (3, 2)].into_iter().enumerate() {
                let wanted = steps.iter().map(|poses| {
                    let theirs: Vec<Convex> =
                        robot.links()[b].shapes().iter().map(|s| s.moved(&poses[b])).collect();
                    least(robot.links()[a].shapes(), &poses[a], &theirs)
                });
                let wanted = wanted.fold(f64::INFINITY, f64::min);
                let gap = suspects.iter().filter(|s| s.1 == Other::Pair(pair)).map(|s| f64::from(s.2[lane]));
                let gap = gap.fold(0.0, f64::min);
                prop_assert!(gap <= 0.0_f64.min(wanted.max(0.0) - 0.02) + 1e-9, "{pair} {gap} {wanted}");
                if gap < 0.0 {
                    let bend = motions.bend(a, Other::Pair(pair), lane);
                    let mut toward = Vector3::from(guess);
                    let proven = screen.keeps_between(a, Other::Pair(pair), ends, 0.02 + bend, &mut toward);
                    prop_assert!(!proven || wanted >= 0.02 - 1e-9, "{pair} {wanted}");
                }
            }
        }
    }
}

#[test]
fn motions_beside_moved_bodies_keep_the_distances_that_are_proven() {
    const STEPS: usize = 16;
    let robot = arm(&[[0.1, 0.1, 0.1], [-0.1, 0.1, -0.1], [0.1, -0.1, -0.1], [-0.1, -0.1, 0.1], [0.1, 0.1, -0.1]]);
    let groups: Vec<Riders<'_>> = (0..4).map(|link| Riders { link, held: None }).collect();
    let door = [Convex::cuboid([0.3, 0.02, 0.2], &pose([0.5, 0.2, 0.3], [0.1, 0.2, 0.3])).unwrap()];
    let none = Pose::identity();
    let screen = Screen::new(&robot, &Cover::of(&robot), &groups, Vec::new(), [(&door[..], &none)]);
    let needs = Needs { bodies: vec![0.01; 4], pairs: Vec::new() };
    let chains = Chains::new(&robot, &screen, &carriers());
    let (origin, axis) = (Point3::new(0.8, 0.1, -0.2), Vector3::new(0.2, 0.3, 0.9).normalize());
    let mut draws = Draws::of(7, 9);
    let (mut proven, mut close) = (0, 0);
    for round in 0..200 {
        let kind = if round % 2 == 0 { JointKind::Revolute } else { JointKind::Prismatic };
        let moved = |travel: f64| match kind {
            JointKind::Revolute => screw_about(&origin.coords, &axis, travel),
            JointKind::Prismatic => Pose::translation(travel * axis.x, travel * axis.y, travel * axis.z),
        };
        let mut motions = Motions::new(chains.clone()).beside(&robot, &BodyJoint { kind, origin, axis });
        let arcs: Vec<Arc> = (0..LANES).map(|_| Arc::of(&mut draws)).collect();
        let travels: Vec<[f64; 2]> = arcs.iter().map(|_| [draws.unit() - 0.5, 0.2 * (draws.unit() - 0.5)]).collect();
        for (lane, (arc, [from, change])) in arcs.iter().zip(&travels).enumerate() {
            let at = |share: f64| -> Vec<f64> { arc.at(share).into_iter().chain([from + share * change]).collect() };
            let apart = change.abs() as f32;
            let own = arc.travel().into_iter().chain([Travel { apart, gone: apart, off: 0.0 }]);
            motions.set(&screen, lane, [&at(0.0), &at(1.0)], &own.collect::<Vec<_>>());
            motions.set_base(lane, [&moved(*from).inverse(), &moved(from + change).inverse()]);
        }
        screen.place_between(&mut motions);
        let mut gaps = [[0.0_f32; LANES]; 4];
        let mut others = [None; 4];
        screen.survey_between(&mut motions, &needs, |s| {
            (gaps[s.group], others[s.group]) = (s.gap, Some(s.other));
            true
        });
        for (lane, (arc, [from, change])) in arcs.iter().zip(&travels).enumerate() {
            let beside = |share: f64| {
                let mut poses = Vec::new();
                robot.link_poses(&arc.at(share), &mut poses).unwrap();
                let base = moved(from + share * change).inverse();
                poses.iter().map(|pose| base * pose).collect::<Vec<Pose>>()
            };
            let ends = [beside(0.0), beside(1.0)];
            for group in 1..4 {
                // The distances are measured in the base frame, with the door where its joint has moved it.
                let places = (0..=STEPS).map(|k| {
                    let share = k as f64 / STEPS as f64;
                    let mut poses = Vec::new();
                    robot.link_poses(&arc.at(share), &mut poses).unwrap();
                    let there = [door[0].moved(&moved(from + share * change))];
                    least(robot.links()[group].shapes(), &poses[group], &there)
                });
                let wanted = places.fold(f64::INFINITY, f64::min);
                close += usize::from(wanted < 0.01);
                let gap = f64::from(gaps[group][lane]).min(0.0);
                assert!(gap <= 0.0_f64.min(wanted.max(0.0) - 0.01) + 1e-6, "{group} {gap} {wanted}");
                if let Some(other) = others[group] {
                    let bend = motions.bend(group, other, lane);
                    let ends = [ends[0].as_slice(), ends[1].as_slice()];
                    if screen.keeps_between(group, other, ends, 0.01 + bend, &mut Vector3::zeros()) {
                        assert!(wanted >= 0.01 - 1e-9, "{group} {wanted}");
                        proven += 1;
                    }
                }
            }
        }
    }
    assert!(proven > 300 && close > 80, "{proven} {close}");
}

#[test]
fn no_point_lies_further_off_its_line_than_its_group_bends() {
    let robot = arm(&[[0.1, 0.1, 0.1], [-0.1, 0.1, -0.1], [0.1, -0.1, -0.1], [-0.1, -0.1, 0.1], [0.1, 0.1, -0.1]]);
    let groups: Vec<Riders<'_>> = (0..4).map(|link| Riders { link, held: None }).collect();
    let ball = [Convex::ball(9.0, Point3::origin()).unwrap()];
    let pairs = [(1, 3), (3, 2), (2, 1)];
    let screen = Screen::new(&robot, &Cover::of(&robot), &groups, pairs.to_vec(), [(&ball[..], &Pose::identity())]);
    let needs = Needs { bodies: vec![9.0; 4], pairs: vec![9.0; 3] };
    let mut motions = Motions::new(Chains::new(&robot, &screen, &carriers()));
    let mut draws = Draws::of(1, 2);
    let mut tightest = [0.0_f64; 2];
    for _ in 0..60 {
        let arcs: Vec<Arc> = (0..LANES).map(|_| Arc::of(&mut draws)).collect();
        for (lane, arc) in arcs.iter().enumerate() {
            motions.set(&screen, lane, [&arc.at(0.0), &arc.at(1.0)], &arc.travel());
        }
        screen.place_between(&mut motions);
        screen.survey_between(&mut motions, &needs, |_| true);
        let seen = (1..4).map(|b| (b, None)).chain((0..3).map(|pair| (pairs[pair].1, Some(pair))));
        for (group, pair) in seen {
            for (lane, arc) in arcs.iter().enumerate() {
                let places = |share: f64| -> Vec<Point3<f64>> {
                    let mut poses = Vec::new();
                    robot.link_poses(&arc.at(share), &mut poses).unwrap();
                    let pose = match pair {
                        Some(pair) => poses[pairs[pair].0].inverse() * poses[group],
                        None => poses[group],
                    };
                    robot.links()[group].shapes().iter().flat_map(Convex::points).map(|p| pose * p).collect()
                };
                let bend = match pair {
                    Some(pair) => motions.bend(pairs[pair].0, Other::Pair(pair), lane),
                    None => motions.bend(group, Other::Element(0), lane),
                };
                let (first, last) = (places(0.0), places(1.0));
                for step in 1..8 {
                    let share = f64::from(step) / 8.0;
                    for ((a, b), p) in first.iter().zip(&last).zip(places(share)) {
                        let off = (p - (a + (b - a) * share)).norm();
                        assert!(off <= bend + 1e-6, "{group} {pair:?} {off} {bend}");
                        let most = &mut tightest[usize::from(pair.is_some())];
                        *most = most.max(off / bend);
                    }
                }
            }
        }
    }
    // The bounds are tight: some motions come close to them.
    assert!(tightest.iter().all(|share| *share > 0.3), "{tightest:?}");
}
