/* Motion planning for robot arms: kinematics, collisions, motions, control loops.
 *
 * UNITS     Metres, radians, seconds. Velocities are in rad/s (m/s for sliding joints), and so on.
 * JOINTS    A joint vector has kpam_scene_joints() numbers in the order of kpam_scene_joint_name(): all moving joints
 *           of the URDF, also those of the fingers. Planning moves the joints between the base and the hand link; the
 *           others keep their values.
 * POSES     16 numbers, row-major: a 4 x 4 matrix T with (r00 r01 r02 x  r10 r11 r12 y  r20 r21 r22 z  0 0 0 1). It
 *           maps points of the link's or body's frame to the base frame: p_base = T p. Eigen stores columns; transpose
 *           its matrices. A rotation that is not orthonormal within 1e-6 is refused.
 * ERRORS    Functions that can fail return a kpam_status. If it is not KPAM_OK, kpam_last_error() returns a message of
 *           one line, which names the argument; the result pointer `out` is null then, and scenes are unchanged.
 *           Arguments that are null, not finite or out of range are refused. No function throws or ends the program.
 * OWNERSHIP A handle that a function stores through `out` belongs to you: free it once with the _free function of its
 *           type. Handles do not depend on each other: a scene may be freed before its motions. Arguments are only read
 *           during the call; the library keeps copies. Returned texts belong to the library.
 * THREADS   Several threads may use one handle at once in functions that take a const pointer to it. Functions that
 *           take a pointer that is not const (adding or moving a body, freeing) need the handle for themselves. Error
 *           messages belong to the thread. A planning call uses the calling thread only.
 * CONTROL   kpam_trajectory_sample_into() takes no lock and allocates no memory if it succeeds, and is meant for control
 *           loops of 1 kHz and more. kpam_cancel_set() does not allocate either. All other functions may allocate.
 * VERSIONS  Compare kpam_abi_version() with KPAM_ABI_VERSION at the start of a program. Later versions with the same ABI
 *           version may have more functions, more members of kpam_status, and more fields at the end of the structs of
 *           options, which begin with their size for this reason.
 */


#ifndef GENSIM2_KPAM_H
#define GENSIM2_KPAM_H

/* Made from crates/capi/src by cbindgen; `cargo test -p gensim2-capi` fails if it is outdated. */

#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>

// Version of the binary interface that this header describes. It increases if a program must be compiled again.
#define KPAM_ABI_VERSION 2

// Status that a function returns.
typedef enum kpam_status {
    // Success.
    KPAM_OK = 0,
    // The search used up its samples or checks, or the tolerance of a hand path is too small. A motion may exist.
    KPAM_NOT_FOUND = 1,
    // An argument is invalid; the message names it.
    KPAM_INVALID = 2,
    // A file cannot be used; the message names the file and the field in it.
    KPAM_FILE = 3,
    // The solver failed because of a bug, which should be reported; nothing was written.
    KPAM_PANIC = 4,
    // Bodies overlap at the start; the message names them.
    KPAM_START_BLOCKED = 5,
    // Bodies overlap at every goal; the message names those of the first goal.
    KPAM_GOALS_BLOCKED = 6,
    // No joint values within the limits bring the link to a goal pose, or the hand cannot follow a line.
    KPAM_UNREACHABLE = 7,
    // A free path was found, but no motion along it within the limits of velocity, acceleration, jerk and torque.
    KPAM_UNTIMED = 8,
    // No motion from the start state stays within a joint's limits; the message names the joint.
    KPAM_CANNOT_STOP = 9,
    // The deadline passed before a motion was found.
    KPAM_LATE = 10,
    // The caller cancelled planning.
    KPAM_CANCELLED = 11,
    // Bodies are too close to the robot on a line of a hand path; the message names them and the pose.
    KPAM_PATH_BLOCKED = 12,
    // A joint cannot hold the arm and its load at rest within the torque limits; the message names the joint.
    KPAM_OVERLOADED = 13,
} kpam_status;

// Acceleration and jerk limits for arms whose URDF lacks them.
typedef enum kpam_limit_set {
    // Default: the limits in the URDF. If the URDF has none, those of `KPAM_LIMITS_PLAIN`; the motion then has a
    // warning.
    KPAM_LIMITS_ASSUMED = 0,
    // 10 rad/s^2 and 5,000 rad/s^3 (m/s^2 and m/s^3) for every joint whose URDF gives none.
    KPAM_LIMITS_PLAIN = 1,
    // Limits published by Franka for the Panda; for 7 joints.
    KPAM_LIMITS_PANDA = 2,
    // Limits published by Franka for the Research 3, with velocity limits that depend on the position; for 7 joints.
    KPAM_LIMITS_FR3 = 3,
} kpam_limit_set;

// Role of a body in the scene.
typedef enum kpam_role {
    // An obstacle at a pose in the base frame.
    KPAM_ROLE_RIGID = 0,
    // A part of the tool or a grasped object: it moves with the hand, and its pose is in the frame of the hand link.
    // It is not checked against this link and the links below it, but against other attached bodies.
    KPAM_ROLE_ATTACHED = 1,
} kpam_role;

// A flag that ends a search from another thread. It cannot be cleared: create a new flag for the next search, or share
// one among all searches that end together.
typedef struct kpam_cancel kpam_cancel;

// A planned motion: its trajectory, the goal that it reaches, and warnings.
typedef struct kpam_motion kpam_motion;

// A list of pairs, closest first.
typedef struct kpam_pairs kpam_pairs;

// A robot and the bodies around it. Functions that take a `const kpam_scene *` may run on several threads at once;
// functions that change a scene need it for themselves. To plan in one thread while another thread updates the bodies,
// give each thread its own copy (`kpam_scene_copy`).
typedef struct kpam_scene kpam_scene;

// A collision shape, in the frame of the body that it becomes a part of. One shape may serve several bodies.
typedef struct kpam_shape kpam_shape;

// A trajectory: position, velocity and acceleration of all joints as functions of time. It does not change, so several
// threads may use it at once.
typedef struct kpam_trajectory kpam_trajectory;

// Options of inverse kinematics. Initialize them with `kpam_ik_options_init`, then set fields.
typedef struct kpam_ik_options {
    // Size of this struct in bytes, which `kpam_ik_options_init` sets.
    size_t size;
    // Link that must reach the pose; null for the hand.
    const char *link;
    // Seed of the start values, 0 to 1,000,000; default 0. The same seed gives the same solutions.
    uint64_t seed;
    // Two solutions differ by at least this (rad or m) in at least one joint, 0.001 to 10; default 0.05.
    double min_distance;
    // Minimum distance (m) from obstacles and between links at a solution, 0 to 0.1. A negative number, the default,
    // ignores collisions.
    double margin;
    // Preferred joint values (rad or m), `kpam_scene_joints` numbers; null for none. A redundant arm is moved toward
    // them without moving the link.
    const double *posture;
    // Weight of each joint's squared distance from `posture`, `kpam_scene_joints` numbers, 0 to 1e6; null for 1 each.
    const double *posture_weights;
    // Weight of the manipulability, 0 to 1e6; default 0. A redundant arm is moved away from singularities.
    double manipulability;
    // Flag that ends the search from another thread; null for none. The solutions found until then are returned.
    const struct kpam_cancel *cancel;
} kpam_ik_options;

// A pair of bodies that are close to each other or overlap.
typedef struct kpam_pair {
    // Name of the first body: a link or an attached body.
    const char *first;
    // Name of the second body: a body of the scene, or another link or attached body.
    const char *second;
    // Signed distance (m): negative if they overlap.
    double distance;
    // Midpoint between the closest points of the two bodies, base frame (m).
    double point[3];
} kpam_pair;

// Options of planning a motion. Initialize them with `kpam_options_init`, then set fields. Arrays have
// `kpam_scene_joints` numbers each; they are read during the call, and not afterwards.
typedef struct kpam_options {
    // Size of this struct in bytes, which `kpam_options_init` sets.
    size_t size;
    // Minimum distance (m) from obstacles and between links along the motion, 0 to 0.1; default 0.005. Pairs that are
    // closer at the start or the goal keep that smaller distance.
    double margin;
    // Fraction of the velocity limits that the motion may use, 0.001 to 1; default 1.
    double velocity_scale;
    // Fraction of the acceleration and jerk limits that the motion may use, 0.001 to 1; default 1.
    double acceleration_scale;
    // Wall-clock limit of the search (ms), up to 1e9; 0, the default, for none. A search without a time limit gives
    // the same motion every time.
    double deadline_ms;
    // Seed of the planner's random samples, 0 to 1,000,000; default 0.
    uint64_t seed;
    // Maximum number of random samples of the search; default 100,000. `kpam_plan_along` ignores it.
    uint64_t samples;
    // Maximum number of configurations that are checked for collisions; 0, the default, for no limit.
    uint64_t max_checks;
    // Flag that ends the search from another thread; null for none.
    const struct kpam_cancel *cancel;
    // Acceleration and jerk limits: a member of `kpam_limit_set`.
    uint32_t limits;
    // Velocity limits (rad/s or m/s); null for those of the URDF. Required if the URDF has none.
    const double *velocity_limits;
    // Acceleration limits (rad/s^2 or m/s^2); null for those of the URDF and of `limits`.
    const double *acceleration_limits;
    // Jerk limits (rad/s^3 or m/s^3); null for those of the URDF and of `limits`.
    const double *jerk_limits;
    // Torque limits (N m; N for sliding joints); null for no limits.
    const double *torque_limits;
    // Velocity at the start (rad/s or m/s); null for rest.
    const double *start_velocity;
    // Acceleration at the start (rad/s^2 or m/s^2); null for zero.
    const double *start_acceleration;
    // Time at which the motion starts (s); default 0.
    double start_time;
    // Trajectory that the arm follows now; null for none. If it passes `q_start` at `start_time`, ends at a goal and
    // is still collision-free, it is continued unless another motion ends earlier.
    const struct kpam_trajectory *warm_start;
} kpam_options;

// Tolerance of a motion along poses. Initialize it with `kpam_path_tolerance_init`, then set fields.
typedef struct kpam_path_tolerance {
    // Size of this struct in bytes, which `kpam_path_tolerance_init` sets.
    size_t size;
    // Maximum distance (m) of the hand's origin from the lines, 0.0001 to 0.1; default 0.001.
    double position;
    // Maximum angle (rad) between the hand's orientation and that of the nearest pose of the line, 0.001 to pi;
    // default 0.01. With a free axis, the angle between the directions of this axis.
    double rotation;
    // Axis of the hand frame (3 numbers) about which the hand may rotate freely, as for a drill; null for none.
    const double *free_axis;
} kpam_path_tolerance;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

// Returns the message of the last call on this thread that did not return `KPAM_OK`; empty if every call returned it.
// The message is one line of UTF-8. It belongs to the library and is valid until the next failing call on this thread.
const char *kpam_last_error(void);

// Returns the version of the binary interface of the loaded library. A program that was compiled with another
// `KPAM_ABI_VERSION` must not call any other function.
uint32_t kpam_abi_version(void);

// Returns the version of the loaded library, such as "0.3.0".
const char *kpam_version(void);

// Loads a robot from a URDF file. Each of its collision meshes becomes its convex hull. `hand_link` is the link that
// carries the tool: poses of the hand are poses of its frame, and the joints between the base and this link are
// planned. `srdf` is a file that disables collision checks between pairs of links; with null, neighbouring links and
// links that overlap in at least 95 % of random configurations are not checked. `base_link` is the link of the base
// frame; null stands for the only link without a parent. Packages that `package://` paths name are searched in
// `ROS_PACKAGE_PATH`, in `AMENT_PREFIX_PATH` and in the folders above the URDF.
//
// # Safety
// The texts are null or zero-terminated strings; `out` can be written.
enum kpam_status kpam_scene_load(const char *urdf,
                                 const char *srdf,
                                 const char *hand_link,
                                 const char *base_link,
                                 struct kpam_scene **out);

// Creates a copy of a scene. The copy shares the robot and the shapes, so that it costs little memory and time;
// changes of one scene do not affect the other.
//
// # Safety
// `scene` is null or a scene that was not freed; `out` can be written.
enum kpam_status kpam_scene_copy(const struct kpam_scene *scene,
                                 struct kpam_scene **out);

// Returns the number of entries of a joint vector: the moving joints of the URDF, also those of the fingers; 0 if
// `scene` is null.
//
// # Safety
// `scene` is null or a scene that was not freed.
size_t kpam_scene_joints(const struct kpam_scene *scene);

// Returns the name of the joint at this index of joint vectors; null if `scene` is null or the index is too large. The
// text is valid until the scene is freed.
//
// # Safety
// `scene` is null or a scene that was not freed.
const char *kpam_scene_joint_name(const struct kpam_scene *scene,
                                  size_t index);

// Returns the name of a link; null if `scene` is null or the index is too large. The text is valid until the scene is
// freed.
//
// # Safety
// `scene` is null or a scene that was not freed.
const char *kpam_scene_link_name(const struct kpam_scene *scene,
                                 size_t index);

// Writes the limits in the URDF, `kpam_scene_joints` numbers each: position (rad or m), velocity (rad/s or m/s),
// acceleration, jerk, and effort (N m; N for sliding joints). A pointer that is null is skipped. Limits that the URDF
// does not give are infinite. `KPAM_LIMITS_ASSUMED` tells which limits motions keep then.
//
// # Safety
// `scene` is null or a scene that was not freed; the other pointers are null or have room for `kpam_scene_joints`
// numbers each.
enum kpam_status kpam_scene_joint_limits(const struct kpam_scene *scene,
                                         double *lower,
                                         double *upper,
                                         double *velocity,
                                         double *acceleration,
                                         double *jerk,
                                         double *effort);

// Adds a body that consists of `count` shapes. Its name must differ from all other bodies and links. `role` is a
// member of `kpam_role`. `pose` is in the base frame, or in the frame of the hand link for an attached body; null is
// the identity. The body keeps its own copy of the shapes.
//
// # Safety
// `scene` is null or a scene that was not freed and that no other thread uses now; `name` is null or a zero-terminated
// string; `shapes` is null or points to `count` handles, each of them null or a shape that was not freed; `pose` is
// null or points to 16 numbers.
enum kpam_status kpam_scene_add_body(struct kpam_scene *scene,
                                     const char *name,
                                     uint32_t role,
                                     const struct kpam_shape *const *shapes,
                                     size_t count,
                                     const double *pose);

// Removes a body.
//
// # Safety
// `scene` is null or a scene that was not freed and that no other thread uses now; `name` is null or a zero-terminated
// string.
enum kpam_status kpam_scene_remove_body(struct kpam_scene *scene,
                                        const char *name);

// Moves a body to another pose in the base frame, or in the frame of the hand link if the body is attached.
//
// # Safety
// `scene` is null or a scene that was not freed and that no other thread uses now; `name` is null or a zero-terminated
// string; `pose` is null or points to 16 numbers.
enum kpam_status kpam_scene_move_body(struct kpam_scene *scene,
                                      const char *name,
                                      const double *pose);

// Attaches a body to the hand link, where the body is while the arm is at joints `q`; its role is then
// `KPAM_ROLE_ATTACHED`. If it overlaps another attached body, such as the tool, no motion can start.
//
// # Safety
// `scene` is null or a scene that was not freed and that no other thread uses now; `name` is null or a zero-terminated
// string; `q` is null or points to `kpam_scene_joints` numbers.
enum kpam_status kpam_scene_attach(struct kpam_scene *scene,
                                   const char *name,
                                   const double *q);

// Releases an attached body where it is while the arm is at joints `q`. It becomes an obstacle with the role
// `KPAM_ROLE_RIGID`.
//
// # Safety
// As for `kpam_scene_attach`.
enum kpam_status kpam_scene_detach(struct kpam_scene *scene, const char *name, const double *q);

// Returns the name of a body; null if `scene` is null or the index is too large. The text is valid until the scene is
// changed or freed.
//
// # Safety
// `scene` is null or a scene that was not freed.
const char *kpam_scene_body_name(const struct kpam_scene *scene,
                                 size_t index);

// Writes the pose of a body: 16 numbers, in the base frame, or in the frame of the hand link if the body is attached.
//
// # Safety
// `scene` is null or a scene that was not freed; `name` is null or a zero-terminated string; `pose` is null or has
// room for 16 numbers.
enum kpam_status kpam_scene_body_pose(const struct kpam_scene *scene,
                                      const char *name,
                                      double *pose);

// Marks the points of a camera's cloud (`count` x 3 numbers, m, base frame) that lie within `clearance` (m, 0 to 10)
// of the robot at joints `q` or of its attached bodies. Remove these points before the cloud becomes an obstacle.
//
// # Safety
// `scene` is null or a scene that was not freed; `q` is null or points to `kpam_scene_joints` numbers; `points` is
// null or points to `count` x 3 numbers; `is_own` is null or has room for `count` values.
enum kpam_status kpam_scene_own_points(const struct kpam_scene *scene,
                                       const double *q,
                                       const double *points,
                                       size_t count,
                                       double clearance,
                                       bool *is_own);

// Frees a scene; null is ignored.
//
// # Safety
// `scene` is null or a scene that was not freed.
void kpam_scene_free(struct kpam_scene *scene);

// Creates a box with half extents (3 numbers, m) along the axes of `pose` in the body frame; a null pose is the
// identity.
//
// # Safety
// `half_extents` is null or points to 3 numbers; `pose` is null or points to 16; `out` can be written.
enum kpam_status kpam_shape_box(const double *half_extents,
                                const double *pose,
                                struct kpam_shape **out);

// Creates a sphere with a radius (m) around `center` (3 numbers, m, body frame); a null centre is the origin.
//
// # Safety
// `center` is null or points to 3 numbers; `out` can be written.
enum kpam_status kpam_shape_sphere(double radius, const double *center, struct kpam_shape **out);

// Creates a capsule with a radius (m) along the z axis of `pose` in the body frame; a null pose is the identity.
// `length` (m) is the distance between the centres of its caps.
//
// # Safety
// `pose` is null or points to 16 numbers; `out` can be written.
enum kpam_status kpam_shape_capsule(double radius,
                                    double length,
                                    const double *pose,
                                    struct kpam_shape **out);

// Creates a cylinder with a radius and a length (m) along the z axis of `pose` in the body frame; a null pose is the
// identity. The cylinder is approximated by a circumscribed prism of 32 sides.
//
// # Safety
// `pose` is null or points to 16 numbers; `out` can be written.
enum kpam_status kpam_shape_cylinder(double radius,
                                     double length,
                                     const double *pose,
                                     struct kpam_shape **out);

// Creates the convex hull of points (`count` x 3 numbers, m, body frame).
//
// # Safety
// `points` is null or points to `count` x 3 numbers; `out` can be written.
enum kpam_status kpam_shape_convex_hull(const double *points, size_t count, struct kpam_shape **out);

// Creates the convex hull of the surface in a mesh file (.stl, .ply, .obj, .dae, .glb or .gltf), as for a collision
// mesh of a URDF. `scale` (3 factors, null for 1 each) multiplies the coordinates; use 0.001 each for a file in
// millimetres. A concave object needs several hulls, or `kpam_shape_mesh`.
//
// # Safety
// `path` is null or a zero-terminated string; `scale` is null or points to 3 numbers; `out` can be written.
enum kpam_status kpam_shape_hull_of_file(const char *path,
                                         const double *scale,
                                         struct kpam_shape **out);

// Creates a surface of `triangle_count` triangles (3 indices each, from 0) over vertices (`vertex_count` x 3 numbers,
// m, body frame). The surface is not solid: a body entirely inside does not collide with it.
//
// # Safety
// `vertices` is null or points to `vertex_count` x 3 numbers; `triangles` is null or points to `triangle_count` x 3
// indices; `out` can be written.
enum kpam_status kpam_shape_mesh(const double *vertices,
                                 size_t vertex_count,
                                 const uint32_t *triangles,
                                 size_t triangle_count,
                                 struct kpam_shape **out);

// Creates a point cloud (`count` x 3 numbers, m, body frame) in which each point is a sphere of a radius (m). An empty
// cloud is no obstacle. Choose at least half the distance between neighbouring points as the radius, so that the cloud
// has no holes; the margin of a motion is kept in addition.
//
// # Safety
// `points` is null or points to `count` x 3 numbers; `out` can be written.
enum kpam_status kpam_shape_point_cloud(const double *points,
                                        size_t count,
                                        double radius,
                                        struct kpam_shape **out);

// Frees a shape; null is ignored. Bodies that were made of the shape stay valid.
//
// # Safety
// `shape` is null or a shape that was not freed.
void kpam_shape_free(struct kpam_shape *shape);

// Writes the pose of a link in the base frame at joints `q`: 16 numbers, row-major. A null `link` is the hand. The
// entries of mimic joints in `q` are ignored: these joints follow their sources.
//
// # Safety
// `scene` is null or a scene that was not freed; `q` is null or points to `kpam_scene_joints` numbers; `link` is null
// or a zero-terminated string; `pose` is null or has room for 16 numbers.
enum kpam_status kpam_scene_forward_kinematics(const struct kpam_scene *scene,
                                               const double *q,
                                               const char *link,
                                               double *pose);

// Writes the Jacobian of a link at joints `q`: 6 rows of `kpam_scene_joints` numbers, row-major, in base axes. The
// first three rows are the linear velocity of the link's origin, the others its angular velocity (m or rad per rad or
// m). A null `link` is the hand. The motion of mimic joints belongs to the columns of their sources; their own columns
// are zero.
//
// # Safety
// As for `kpam_scene_forward_kinematics`; `jacobian` is null or has room for 6 x `kpam_scene_joints` numbers.
enum kpam_status kpam_scene_jacobian(const struct kpam_scene *scene,
                                     const double *q,
                                     const char *link,
                                     double *jacobian);

// Writes the default options. Call it with the size of the struct: `kpam_ik_options_init(&options, sizeof options)`.
//
// # Safety
// `options` is null or has room for `size` bytes.
enum kpam_status kpam_ik_options_init(struct kpam_ik_options *options,
                                      size_t size);

// Writes up to `max_solutions` (1 to 256) joint vectors that bring the hand, or the link in the options, to a pose in
// the base frame, and the number of the vectors to `count`. The number is 0 if none was found, which is no error: the
// function returns `KPAM_OK`, and `solutions` does not contain a solution.
//
// The vectors are distinct, one after another in `solutions`, best first: closest to `q_start`, or by the objective of
// `posture` and `manipulability` in the options. Joints that do not move the hand keep their values of `q_start`. With
// 256, an arm of six joints gets all solutions, unless joint ranges above a turn multiply their number; a redundant
// arm gets a sample of its solutions.
//
// # Safety
// `scene` is null or a scene that was not freed; `pose` is null or points to 16 numbers; `q_start` is null or points
// to `kpam_scene_joints` numbers; `options` is null or points to initialized options, whose pointers are valid;
// `solutions` is null or has room for `max_solutions` x `kpam_scene_joints` numbers; `count` is null or can be
// written.
enum kpam_status kpam_scene_ik(const struct kpam_scene *scene,
                               const double *pose,
                               const double *q_start,
                               const struct kpam_ik_options *options,
                               size_t max_solutions,
                               double *solutions,
                               size_t *count);

// Writes for each of `count` joint vectors (one after another in `q`) whether the robot overlaps a body or itself.
//
// Fixed links, pairs that the SRDF disables, and attached bodies against the hand link are not checked. The first
// check after a change of the scene prepares it, which takes seconds for bodies with millions of points or triangles.
//
// # Safety
// `scene` is null or a scene that was not freed; `q` is null or points to `count` x `kpam_scene_joints` numbers;
// `hits` is null or has room for `count` values.
enum kpam_status kpam_scene_in_collision(const struct kpam_scene *scene,
                                         const double *q,
                                         size_t count,
                                         bool *hits);

// Writes for each of `count` joint vectors the smallest signed distance (m) over the pairs that
// `kpam_scene_in_collision` checks: negative if they overlap, and at most `max_distance` (m, 0 to 10).
// `kpam_scene_check` also names the pairs.
//
// # Safety
// `scene` is null or a scene that was not freed; `q` is null or points to `count` x `kpam_scene_joints` numbers;
// `distances` is null or has room for `count` numbers.
enum kpam_status kpam_scene_distance(const struct kpam_scene *scene,
                                     const double *q,
                                     size_t count,
                                     double max_distance,
                                     double *distances);

// Creates the list of the pairs that are closer than `reach` (m, 0 to 10) at joints `q`, closest first; with 0, the
// pairs that overlap. The list may be empty.
//
// # Safety
// `scene` is null or a scene that was not freed; `q` is null or points to `kpam_scene_joints` numbers; `out` can be
// written.
enum kpam_status kpam_scene_check(const struct kpam_scene *scene,
                                  const double *q,
                                  double reach,
                                  struct kpam_pairs **out);

// Returns a pair of a list; null if `pairs` is null or the index is too large. The pair and its names are valid until
// the list is freed.
//
// # Safety
// `pairs` is null or a list that was not freed.
const struct kpam_pair *kpam_pairs_at(const struct kpam_pairs *pairs,
                                      size_t index);

// Frees a list of pairs; null is ignored.
//
// # Safety
// `pairs` is null or a list that was not freed.
void kpam_pairs_free(struct kpam_pairs *pairs);

// Writes the default options. Call it with the size of the struct: `kpam_options_init(&options, sizeof options)`.
//
// # Safety
// `options` is null or has room for `size` bytes.
enum kpam_status kpam_options_init(struct kpam_options *options,
                                   size_t size);

// Writes the default tolerance. Call it with the size of the struct, as `kpam_options_init`.
//
// # Safety
// `tolerance` is null or has room for `size` bytes.
enum kpam_status kpam_path_tolerance_init(struct kpam_path_tolerance *tolerance, size_t size);

// Plans a timed motion from `q_start` to rest at one of `count` joint vectors (one after another in `goals`),
// whichever is easiest to reach. Joints that do not move the hand keep their values, which the goals must contain.
//
// The motion begins at rest, or with `start_velocity` and `start_acceleration` in the options: `q_start` and these two
// are then the state of the moving arm at `start_time`. Each configuration of the motion keeps the margin.
//
// # Safety
// `scene` is null or a scene that was not freed; `q_start` is null or points to `kpam_scene_joints` numbers, and
// `goals` is null or points to `count` times as many; `options` is null or points to initialized options, whose
// pointers are valid; `out` can be written.
enum kpam_status kpam_plan_to_joints(const struct kpam_scene *scene,
                                     const double *q_start,
                                     const double *goals,
                                     size_t count,
                                     const struct kpam_options *options,
                                     struct kpam_motion **out);

// Plans a timed motion from `q_start` to rest with a link at one of `count` poses (1 to 256, 16 numbers each, base
// frame), whichever is easiest to reach. A null `link` is the hand. Start and options are those of
// `kpam_plan_to_joints`.
//
// # Safety
// As for `kpam_plan_to_joints`, but `goals` is null or points to `count` x 16 numbers; `link` is null or a
// zero-terminated string.
enum kpam_status kpam_plan_to_poses(const struct kpam_scene *scene,
                                    const double *q_start,
                                    const double *goals,
                                    size_t count,
                                    const char *link,
                                    const struct kpam_options *options,
                                    struct kpam_motion **out);

// Plans a timed motion from rest at `q_start` that brings the hand to each of `count` poses (up to 10,000, 16 numbers
// each, base frame) in turn. The hand moves on straight lines and rotates uniformly, from its pose at `q_start` to the
// first pose and from each pose to the next, within the tolerance (null for 1 mm and 0.01 rad). It stops at a pose
// only if it could not keep the tolerance otherwise. `start_velocity`, `start_acceleration` and `warm_start` must be
// null.
//
// # Safety
// As for `kpam_plan_to_joints`; `poses` is null or points to `count` x 16 numbers; `tolerance` is null or points to an
// initialized tolerance, whose pointers are valid.
enum kpam_status kpam_plan_along(const struct kpam_scene *scene,
                                 const double *q_start,
                                 const double *poses,
                                 size_t count,
                                 const struct kpam_path_tolerance *tolerance,
                                 const struct kpam_options *options,
                                 struct kpam_motion **out);

// Creates the trajectory of a motion, which stays valid after the motion is freed.
//
// # Safety
// `motion` is null or a motion that was not freed; `out` can be written.
enum kpam_status kpam_motion_trajectory(const struct kpam_motion *motion, struct kpam_trajectory **out);

// Returns the index of the goal at which a motion ends, among the joint vectors or poses that were given; `SIZE_MAX`
// if `motion` is null.
//
// # Safety
// `motion` is null or a motion that was not freed.
size_t kpam_motion_goal(const struct kpam_motion *motion);

// Returns a warning about a motion, counted from 0: assumed limits with their joints, and links that are never checked
// for collisions. Null if there are no more, or `motion` is null. The text is valid until the motion is freed.
//
// # Safety
// `motion` is null or a motion that was not freed.
const char *kpam_motion_warning(const struct kpam_motion *motion,
                                size_t index);

// Returns the name of a limit, counted from 0, for which defaults are assumed because neither the options nor the URDF
// give it: "acceleration" or "jerk". Null if there are no more, or `motion` is null. The text is valid until the
// motion is freed.
//
// # Safety
// `motion` is null or a motion that was not freed.
const char *kpam_motion_assumed_limit(const struct kpam_motion *motion,
                                      size_t index);

// Frees a motion; null is ignored.
//
// # Safety
// `motion` is null or a motion that was not freed.
void kpam_motion_free(struct kpam_motion *motion);

// Returns the start time of a trajectory (s); NaN if `trajectory` is null.
//
// # Safety
// `trajectory` is null or a trajectory that was not freed.
double kpam_trajectory_start(const struct kpam_trajectory *trajectory);

// Returns the end time of a trajectory (s); NaN if `trajectory` is null.
//
// # Safety
// `trajectory` is null or a trajectory that was not freed.
double kpam_trajectory_end(const struct kpam_trajectory *trajectory);

// Returns the number of entries of a joint vector; 0 if `trajectory` is null.
//
// # Safety
// `trajectory` is null or a trajectory that was not freed.
size_t kpam_trajectory_joints(const struct kpam_trajectory *trajectory);

// Writes position, velocity and acceleration at time `t` (s), `kpam_trajectory_joints` numbers each. Times before the
// start give the state at the start; after the end, the arm is at rest. The function takes no lock, and allocates
// no memory if it returns `KPAM_OK`.
//
// # Safety
// `trajectory` is null or a trajectory that was not freed; the other pointers are null or have room for
// `kpam_trajectory_joints` numbers each, and do not overlap.
enum kpam_status kpam_trajectory_sample_into(const struct kpam_trajectory *trajectory,
                                             double t,
                                             double *position,
                                             double *velocity,
                                             double *acceleration);

// Creates a stop that begins at time `t` (s) in the state of the trajectory and brakes along its path as hard as the
// limits of velocity, acceleration and jerk allow. If no stop along the path keeps the limits, for example just before
// the path reverses, every joint stops independently as fast as it can, and the arm may leave the path. The stop may
// need more torque than the trajectory, and is not checked for collisions off the path.
//
// # Safety
// `trajectory` is null or a trajectory that was not freed; `out` can be written.
enum kpam_status kpam_trajectory_brake(const struct kpam_trajectory *trajectory,
                                       double t,
                                       struct kpam_trajectory **out);

// Creates the part of a trajectory from time `t` (s) on. Use it to keep a repeatedly spliced trajectory short.
//
// # Safety
// `trajectory` is null or a trajectory that was not freed; `out` can be written.
enum kpam_status kpam_trajectory_since(const struct kpam_trajectory *trajectory,
                                       double t,
                                       struct kpam_trajectory **out);

// Creates the trajectory that follows `trajectory` until time `t` (s) and `next` from then on. Both must have the same
// state at `t` (within 1e-6 in position, velocity and acceleration), and the same values of joints that neither of
// them moves.
//
// # Safety
// `trajectory` and `next` are null or trajectories that were not freed; `out` can be written.
enum kpam_status kpam_trajectory_splice(const struct kpam_trajectory *trajectory,
                                        const struct kpam_trajectory *next,
                                        double t,
                                        struct kpam_trajectory **out);

// Creates the fastest trajectory found through waypoints (`count` rows of `joints` numbers) within velocity,
// acceleration and jerk limits (`joints` numbers each). It begins at `start_time` with `start_velocity` and
// `start_acceleration`; null means at rest.
//
// # Safety
// All pointers except `out` are null or point to arrays of the sizes above; `out` can be written.
enum kpam_status kpam_retime(const double *waypoints,
                             size_t count,
                             size_t joints,
                             const double *velocity_limits,
                             const double *acceleration_limits,
                             const double *jerk_limits,
                             const double *start_velocity,
                             const double *start_acceleration,
                             double start_time,
                             struct kpam_trajectory **out);

// Frees a trajectory; null is ignored.
//
// # Safety
// `trajectory` is null or a trajectory that was not freed.
void kpam_trajectory_free(struct kpam_trajectory *trajectory);

// Creates a flag that is not set.
//
// # Safety
// `out` can be written.
enum kpam_status kpam_cancel_create(struct kpam_cancel **out);

// Sets the flag. A search that uses it ends soon with `KPAM_CANCELLED`. Any thread may call this function at any time,
// also a signal handler. Null is ignored.
//
// # Safety
// `cancel` is null or a flag that was not freed.
void kpam_cancel_set(const struct kpam_cancel *cancel);

// Returns whether the flag is set; false if `cancel` is null.
//
// # Safety
// `cancel` is null or a flag that was not freed.
bool kpam_cancel_is_set(const struct kpam_cancel *cancel);

// Frees a flag; null is ignored. Free it after the searches that use it have returned, and after the last
// `kpam_cancel_set`.
//
// # Safety
// `cancel` is null or a flag that was not freed.
void kpam_cancel_free(struct kpam_cancel *cancel);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* GENSIM2_KPAM_H */
