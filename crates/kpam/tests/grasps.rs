//! Tests grasps of shapes for which the possible grasps are known, without using the search's own checks.

#![allow(clippy::unwrap_used)]

use std::sync::Arc;

use gensim2_geometry::{Convex, Corners, Joint, Link, Pose, Robot, signed_distance};
use gensim2_kpam::grasp::GripperKeypoints;
use gensim2_kpam::{Body, Grasp, GraspOptions, ParallelGripper, ProblemError, Role, Scene};
use nalgebra::{Point3, Rotation3, Translation3, Vector3};
use proptest::prelude::*;

const STROKE: f64 = 0.08;

/// Returns the default options, changed by `set`. The gripper in the tests has pads of 20 x 20 mm, fingers of 15 x 50
/// mm, and a palm.
fn options(set: impl FnOnce(&mut GraspOptions)) -> GraspOptions {
    let mut options = GraspOptions::default();
    set(&mut options);
    options
}

fn gripper() -> ParallelGripper {
    let keypoints = GripperKeypoints {
        head: Vector3::new(0.0, 0.0, 0.1),
        tail: Vector3::new(0.0, 0.0, 0.05),
        side: Vector3::new(0.05, 0.0, 0.1),
    };
    let finger =
        |side: f64| vec![Convex::cuboid([0.0075, 0.01, 0.025], &Pose::translation(side * 0.0075, 0.0, 0.085)).unwrap()];
    let palm = vec![Convex::cuboid([0.1, 0.03, 0.03], &Pose::translation(0.0, 0.0, 0.03)).unwrap()];
    let grip = ParallelGripper::frame(&keypoints).unwrap();
    ParallelGripper::new(grip, [0.01, 0.01], [0.0, STROKE], palm, [finger(-1.0), finger(1.0)]).unwrap()
}

fn body(role: Role, shapes: Vec<Convex>, pose: Pose) -> Body {
    Body::builder(format!("{role:?}"), role).shapes(shapes).pose(pose).build().unwrap()
}

fn cuboid(half: [f64; 3], pose: Pose) -> Body {
    body(Role::Target, vec![Convex::cuboid(half, &Pose::identity()).unwrap()], pose)
}

fn table() -> Body {
    body(
        Role::Table,
        vec![Convex::cuboid([1.0, 1.0, 0.05], &Pose::translation(0.0, 0.0, -0.05)).unwrap()],
        Pose::identity(),
    )
}

/// Returns grasps of `object` among the bodies `others`. The robot's arm is far away from them.
fn grasps(object: &Body, others: &[Body], options: &GraspOptions) -> Result<Vec<Grasp>, ProblemError> {
    let slide = Joint::prismatic("x", Vector3::x()).limits(-1.0, 1.0);
    let robot = Robot::builder("cart").link(Link::base("rail")).link(Link::below("rail", "cart").moved_by(slide));
    let bodies = std::iter::once(object).chain(others).cloned().collect();
    let scene = Scene::new(Arc::new(robot.build("cart").unwrap()), bodies, vec![])?;
    scene.grasps(object.name(), &gripper(), None, options)
}

fn found(object: &Body, others: &[Body], options: &GraspOptions) -> Vec<Grasp> {
    grasps(object, others, options).unwrap()
}

fn closing(grasp: &Grasp) -> Vector3<f64> {
    grasp.object_hand.rotation * Vector3::x()
}

fn between_pads(grasp: &Grasp) -> Point3<f64> {
    grasp.object_hand * Point3::new(0.0, 0.0, 0.1)
}

#[test]
fn a_box_is_held_across_its_narrow_sides() {
    let object = cuboid([0.02, 0.06, 0.03], Pose::identity());
    let all = found(&object, &[], &options(|o| o.up = None));
    assert!(all.len() > 20, "{}", all.len());
    for grasp in &all {
        // Opposite faces are parallel, so the pads close perpendicular to them. Only the widths of 40 and 60 mm fit
        // between the pads.
        let axis = closing(grasp).abs();
        let wide = if axis.x > 0.999 { 0.04 } else { 0.06 };
        assert!(axis.x > 0.999 || axis.z > 0.999, "{axis}");
        assert!((grasp.width - wide).abs() < 1e-9, "{}", grasp.width);
        assert!((grasp.quality.friction_margin - 0.6f64.atan()).abs() < 1e-6);
        assert!(grasp.opening > grasp.width && grasp.opening <= STROKE);
        // The pads are centred on the middle between the faces.
        let middle = between_pads(grasp);
        assert!(if axis.x > 0.999 { middle.x.abs() } else { middle.z.abs() } < 1e-9);
    }
    assert!(all.windows(2).all(|pair| pair[0].score >= pair[1].score));
}

#[test]
fn what_is_wider_than_the_stroke_is_not_held() {
    let object = cuboid([0.05, 0.05, 0.05], Pose::identity());
    assert!(found(&object, &[], &GraspOptions::default()).is_empty());
    let wedge: Vec<_> = [(-0.05, 0.0), (0.05, 0.0), (0.0, 0.03)]
        .iter()
        .flat_map(|(x, z)| [-0.05, 0.05].map(|y| Point3::new(*x, y, *z)))
        .collect();
    // The sides of a wedge are 118 degrees apart, too much for the friction; its ends are too far apart.
    let wedge = body(Role::Target, vec![Convex::hull(&wedge).unwrap()], Pose::identity());
    assert!(found(&wedge, &[], &options(|o| o.friction = 0.3)).is_empty());
}

#[test]
fn a_ball_is_held_through_its_middle() {
    let ball = body(Role::Target, vec![Convex::ball(0.025, Point3::new(0.1, 0.0, 0.0)).unwrap()], Pose::identity());
    let all = found(&ball, &[], &options(|o| o.up = None));
    assert!(all.len() > 50, "{}", all.len());
    for grasp in &all {
        let from_middle = between_pads(grasp) - Point3::new(0.1, 0.0, 0.0);
        assert!(from_middle.dot(&closing(grasp)).abs() < 1e-3, "not midway: {from_middle}");
        assert!(from_middle.norm() < 0.015, "past the ball's middle: {from_middle}");
        assert!((0.043..0.0501).contains(&grasp.width), "{}", grasp.width);
    }
}

#[test]
fn a_standing_cylinder_is_held_across_its_axis_from_above() {
    let cylinder = Convex::cylinder(0.03, 0.12, &Pose::identity()).unwrap();
    let object = body(Role::Target, vec![cylinder], Pose::translation(0.4, 0.1, 0.06));
    let all = found(&object, &[table()], &GraspOptions::default());
    assert!(!all.is_empty());
    for grasp in &all {
        assert!(closing(grasp).z.abs() < 0.3, "{}", closing(grasp));
        assert!((grasp.width - 0.06).abs() < 1e-3, "{}", grasp.width);
        assert!(grasp.approach.z < 0.3);
    }
}

#[test]
fn thin_walls_are_held_from_both_sides() {
    // A box without a lid: four walls of 4 mm around a square of 100 mm, and a floor.
    let wall = |x: f64, y: f64| {
        let half = if x == 0.0 { [0.052, 0.002, 0.03] } else { [0.002, 0.052, 0.03] };
        Convex::cuboid(half, &Pose::translation(x, y, 0.0)).unwrap()
    };
    let walls = vec![wall(0.052, 0.0), wall(-0.052, 0.0), wall(0.0, 0.052), wall(0.0, -0.052)];
    let all =
        found(&body(Role::Target, walls, Pose::translation(0.0, 0.0, 0.03)), &[table()], &GraspOptions::default());
    assert!(!all.is_empty());
    assert!(all.iter().any(|g| (g.width - 0.004).abs() < 1e-9 && g.approach.z < -0.99));
}

#[test]
fn a_closed_mesh_is_held_like_its_hull() {
    let half = [0.02, 0.05, 0.03];
    let hull = cuboid(half, Pose::identity());
    let triangles = hull.shapes()[0].triangles();
    // Shapes do not store which side of a triangle is outside.
    let shapes = triangles.iter().map(|t| Convex::hull(t).unwrap()).collect();
    let mesh = body(Role::Target, shapes, Pose::identity());
    let options = options(|o| o.up = None);
    let (from_hull, from_mesh) = (found(&hull, &[], &options), found(&mesh, &[], &options));
    assert!(from_mesh.len() > 20 && from_mesh.len().abs_diff(from_hull.len()) < 10, "{}", from_mesh.len());
    for grasp in &from_mesh {
        assert!([0.04, 0.06].iter().any(|w| (grasp.width - w).abs() < 1e-9), "{}", grasp.width);
    }
}

#[test]
fn bad_input_names_its_field() {
    let object = cuboid([0.02, 0.02, 0.02], Pose::identity());
    let field = |options: GraspOptions| grasps(&object, &[], &options).unwrap_err().field;
    assert_eq!(field(options(|o| o.count = 0)), "options.count");
    assert_eq!(field(options(|o| o.samples = 0)), "options.samples");
    assert_eq!(field(options(|o| o.trials = 0)), "options.trials");
    assert_eq!(field(options(|o| o.friction = f64::NAN)), "options.friction");
    assert_eq!(field(options(|o| o.approach = -0.1)), "options.approach");
    assert_eq!(field(options(|o| o.clearance = 1.0)), "options.clearance");
    assert_eq!(field(options(|o| o.up = Some([0.0; 3]))), "options.up");
    for tilt in [[-0.1, 1.0], [1.0, 0.9], [0.0, 4.0], [f64::NAN, 1.0]] {
        assert_eq!(field(options(|o| o.tilt = tilt)), "options.tilt");
    }
    let flat: Vec<_> = (0..4).map(|i| Point3::new(f64::from(i % 2), f64::from(i / 2), 0.0)).collect();
    let flat = body(Role::Target, vec![Convex::hull(&flat).unwrap()], Pose::identity());
    let error = grasps(&flat, &[], &GraspOptions::default()).unwrap_err();
    assert_eq!(error.field, "body.shapes");
}

/// Returns the minimum distance of the hand from bodies, in small steps of the approach and of closing the fingers.
fn least_distance(grasp: &Grasp, bodies: &[&Body], approach: f64) -> f64 {
    let gripper = gripper();
    let mut least = f64::INFINITY;
    let mut look = |hand: &Pose, opening: f64, palm: bool| {
        let finger = |side: f64| *hand * Translation3::new(side * 0.5 * opening, 0.0, 0.0);
        let fingers = [finger(-1.0), finger(1.0)];
        let moving =
            gripper.fingers().iter().zip(&fingers).flat_map(|(shapes, pose)| shapes.iter().map(move |s| (s, pose)));
        let still = gripper.palm().iter().filter(|_| palm).map(|s| (s, hand));
        for (shape, pose) in moving.chain(still) {
            let mine = Corners::of(shape.moved(pose).points());
            for other in bodies.iter().flat_map(|b| b.shapes().iter().map(|s| s.moved(b.pose()))) {
                let mut toward = other.center() - pose * shape.center();
                let pair = ((&mine, 0.0), (&Corners::of(other.points()), other.radius()));
                let contact = signed_distance(pair.0, pair.1, &mut toward, 10.0).unwrap();
                least = least.min(contact.distance);
            }
        }
    };
    for step in 0..=20 {
        let back = Vector3::new(0.0, 0.0, -approach * f64::from(step) / 20.0);
        look(&(grasp.base_hand * Translation3::from(back)), grasp.opening, true);
    }
    for step in 0..20 {
        let opening = grasp.opening + (grasp.width + 0.002 - grasp.opening) * f64::from(step) / 19.0;
        look(&grasp.base_hand, opening.max(grasp.width + 0.002), false);
    }
    least
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    #[test]
    fn the_way_to_a_grasp_is_free_and_its_pads_fit(
        half in prop::array::uniform3(0.008..0.045f64),
        turn in prop::array::uniform3(-1.5..1.5f64),
        neighbour in -0.12..0.12f64,
        round in any::<bool>(),
    ) {
        let rotation = Rotation3::new(Vector3::from(turn));
        let shape = if round {
            Convex::capsule(half[0], 2.0 * half[1], &Pose::identity()).unwrap()
        } else {
            Convex::cuboid(half, &Pose::identity()).unwrap()
        };
        let low = shape.moved(&Pose::from_parts(Translation3::identity(), rotation)).aabb_at(&Pose::identity()).min.z;
        let object = body(Role::Target, vec![shape], Pose::from_parts(Translation3::new(0.4, 0.0, -low), rotation));
        let post = Convex::cuboid([0.01, 0.01, 0.06], &Pose::identity()).unwrap();
        let others = [table(), body(Role::Rigid, vec![post], Pose::translation(0.4 + neighbour, 0.1, 0.06))];
        let options = options(|o| (o.count, o.trials) = (20, 300));
        for grasp in found(&object, &others, &options) {
            prop_assert!(grasp.width < grasp.opening && grasp.opening <= STROKE);
            prop_assert!((grasp.base_hand.translation.vector
                - (object.pose() * grasp.object_hand).translation.vector).norm() < 1e-12);
            prop_assert!((0.0..=1.0).contains(&grasp.score));
            let kept = least_distance(&grasp, &[&others[0], &others[1]], options.approach);
            prop_assert!(kept >= options.clearance - 1e-6, "{kept} from the scene: {grasp:?}");
            let kept = least_distance(&grasp, &[&object], options.approach);
            prop_assert!(kept >= 0.4e-3, "{kept} from the object: {grasp:?}");
        }
    }
}

#[test]
fn the_same_question_has_the_same_answer() {
    let object = cuboid([0.02, 0.03, 0.04], Pose::translation(0.4, 0.0, 0.04));
    let ask = || serde_json::to_string(&found(&object, &[table()], &GraspOptions::default())).unwrap();
    assert_eq!(ask(), ask());
}

#[test]
fn a_knob_is_found_where_every_part_is_sampled_equally_often() {
    let (panel, knob) =
        (Convex::cuboid([0.2, 0.05, 0.15], &Pose::identity()).unwrap(), Pose::translation(0.0, 0.065, 0.0));
    let knob = Convex::cuboid([0.01, 0.015, 0.01], &knob).unwrap();
    let drawer = body(Role::MovingLink, vec![panel, knob], Pose::identity());
    let sampled = |per_part: bool| options(|o| (o.samples, o.per_part) = (128, per_part));
    assert_eq!(found(&drawer, &[], &sampled(false)), vec![]);
    let grasps = found(&drawer, &[], &sampled(true));
    assert!(!grasps.is_empty());
    for grasp in grasps {
        let between = grasp.object_hand * Point3::from(gripper().grip().translation.vector);
        assert!((between - Point3::new(0.0, 0.065, 0.0)).amax() < 0.03, "{between}");
    }
}

#[test]
fn as_many_grasps_lean_as_are_asked_for() {
    // For an upright block, a hundred grasps from above rank higher than the best grasp from the side.
    let object = cuboid([0.02, 0.02, 0.05], Pose::translation(0.4, 0.0, 0.05));
    let leaning = |grasp: &Grasp| (0.6..=1.6).contains(&grasp.quality.tilt);
    let all = found(&object, &[table()], &options(|o| o.count = 60));
    assert_eq!(all.len(), 60);
    assert!(all.iter().filter(|grasp| leaning(grasp)).count() < 20);
    let some = found(&object, &[table()], &options(|o| (o.count, o.tilt) = (60, [0.6, 1.6])));
    assert_eq!(some.len(), 60);
    assert!(some.iter().all(leaning));
}
