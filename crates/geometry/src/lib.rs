//! Robots from URDF, forward kinematics and Jacobians, convex shapes and signed distances.
//!
//! Metres, radians, seconds. `T_a_b` maps coordinates in `b` to `a`. This crate is independent of tasks, keypoints and
//! Python. No function panics: an unsuitable argument gives an error or `None`, or is ignored, as documented.
//!
//! ```
//! use gensim2_geometry::Robot;
//!
//! let urdf = r#"<robot name="pendulum">
//!   <link name="base"/><link name="bob"/>
//!   <joint name="hinge" type="revolute">
//!     <parent link="base"/><child link="bob"/><origin xyz="0 0 1"/><axis xyz="0 1 0"/>
//!     <limit lower="-3" upper="3" effort="1" velocity="2"/>
//!   </joint>
//! </robot>"#;
//! let robot = Robot::from_urdf_str(urdf, "pendulum.urdf", None, "bob", None)?;
//! let pose = robot.link_pose(&[0.5], robot.hand()).ok_or("one joint")?;
//! assert!((pose.translation.vector.z - 1.0).abs() < 1e-12);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod builder;
mod bvh;
mod chain;
mod checked;
mod collision;
mod convex;
mod corners;
mod dae;
mod decompose;
mod description;
mod distance;
mod draws;
mod dynamics;
mod error;
mod facets;
mod file;
mod gltf;
pub mod lanes;
mod link;
mod mesh;
mod mesh_path;
mod mimic;
mod obj;
mod obstacles;
mod own_points;
mod ply;
mod pose;
mod robot;
mod screen;
mod self_collisions;
mod srdf;
mod urdf;
mod voxels;
mod xml;

pub use builder::{JointBuilder, LinkBuilder, RobotBuilder};
pub use bvh::{Aabb, Bvh};
pub use chain::{Chain, ChainFrames};
pub use collision::{MovingShapes, Proximity, Scratch, Target, checked_pairs};
pub use convex::Convex;
pub use corners::Corners;
pub use description::{
    Description, Geometry, InertialDescription, JointDescription, LimitDescription, LinkDescription, MimicDescription,
    Origin, ShapeDescription,
};
pub use distance::{Contact, signed_distance};
pub use draws::Draws;
pub use dynamics::{DynamicsScratch, GRAVITY, Inertia};
pub use error::{JointCountError, RobotError, ShapeError, UrdfError};
pub use link::{Joint, JointKind, Link, Mimic};
pub use obj::Obj;
pub use obstacles::Obstacles;
pub use own_points::points_within;
pub use pose::{
    Pose, is_rigid, pose_from_matrix, pose_from_xyz_rpy, pose_to_matrix, rotation_about, rotation_log, screw_about,
};
pub use robot::Robot;
pub use screen::{
    Batch, BodyJoint, Chains, Cover, Frames, LANES, Measure, Motions, Needs, Other, Points, Posing, Riders, Screen,
    Suspect, Travel,
};
pub use self_collisions::{ALWAYS, LinkPair, LinkRelation, SAMPLES};
pub use voxels::{VoxelGrid, cubes};
