#ifndef GENSIM2_KPAM_H
#define GENSIM2_KPAM_H

/* Made from crates/capi/src by cbindgen; `cargo test -p gensim2-capi` fails if it is outdated. */

#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>

// Status that a function returns.
typedef enum kpam_status {
    // Success.
    KPAM_OK = 0,
    // No motion was found, or none exists; the message gives the reason.
    KPAM_NO_MOTION = 1,
    // An argument is invalid; the message names it.
    KPAM_INVALID = 2,
    // A file cannot be used; the message names the file and the field in it.
    KPAM_FILE = 3,
    // The solver failed because of a bug, which should be reported; nothing was written.
    KPAM_PANIC = 4,
} kpam_status;

// Acceleration and jerk limits for arms whose URDF lacks them.
typedef enum kpam_limit_set {
    // Default: 10 rad/s^2 and 5,000 rad/s^3 for every joint.
    KPAM_LIMITS_PLAIN = 0,
    // Limits published by Franka for the Panda.
    KPAM_LIMITS_PANDA = 1,
    // Limits published by Franka for the Research 3, with velocity limits that depend on the position.
    KPAM_LIMITS_FR3 = 2,
} kpam_limit_set;

// A robot and its surroundings.
typedef struct kpam_scene kpam_scene;

// A timed motion of all joints.
typedef struct kpam_trajectory kpam_trajectory;

// Options of planning a motion; `kpam_options_default` returns the defaults.
typedef struct kpam_options {
    // Minimum distance (m) between the robot and all obstacles along the motion, 0 to 0.1.
    double margin;
    // Fraction of the velocity limits that the motion may use, above 0, at most 1.
    double velocity_scale;
    // Fraction of the acceleration and jerk limits that the motion may use, above 0, at most 1.
    double acceleration_scale;
    // Wall-clock limit of the search (ms); 0 for no limit.
    double deadline_ms;
    // Seed of the planner's random samples.
    uint64_t seed;
    // Acceleration and jerk limits: a member of `kpam_limit_set`.
    uint32_t limits;
} kpam_options;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

// Returns the message of the last call on this thread that did not return `KPAM_OK`; empty if every call returned it.
// The text is valid until the next failing call on this thread.
const char *kpam_last_error(void);

// Returns the default options: a margin of 5 mm, scales of 1, no time limit, seed 0, `KPAM_LIMITS_PLAIN`.
struct kpam_options kpam_options_default(void);

// Loads a robot. `urdf` is its file, `srdf` a file that disables pairs of links (null for none), and `hand_link` the
// link that carries the tool.
//
// # Safety
// `urdf`, `srdf` and `hand_link` are null or zero-terminated strings; `out` can be written.
enum kpam_status kpam_scene_load(const char *urdf,
                                 const char *srdf,
                                 const char *hand_link,
                                 struct kpam_scene **out);

// Returns the number of entries of a joint vector; 0 if `scene` is null.
//
// # Safety
// `scene` is null or a scene that was not freed.
size_t kpam_scene_joints(const struct kpam_scene *scene);

// Adds a fixed box to the scene: half extents (3 numbers, m) and pose (16 numbers, row-major, base frame).
//
// # Safety
// `scene` is null or a scene that was not freed and that no other thread uses now; `name` is null or a zero-terminated
// string; `half_extents` is null or points to 3 numbers, `pose` is null or points to 16.
enum kpam_status kpam_scene_add_box(struct kpam_scene *scene,
                                    const char *name,
                                    const double *half_extents,
                                    const double *pose);

// Plans a timed motion from rest at `q_start` to rest at `q_goal` that keeps the margin from all obstacles. Each
// vector has `kpam_scene_joints` entries; `options` may be null.
//
// # Safety
// `scene` is null or a scene that was not freed; `q_start` and `q_goal` are null or point to `kpam_scene_joints`
// numbers each; `options` is null or can be read; `out` can be written.
enum kpam_status kpam_plan_joints(const struct kpam_scene *scene,
                                  const double *q_start,
                                  const double *q_goal,
                                  const struct kpam_options *options,
                                  struct kpam_trajectory **out);

// Frees a scene; null is ignored.
//
// # Safety
// `scene` is null or a scene that was not freed.
void kpam_scene_free(struct kpam_scene *scene);

// Returns the start time of a motion (s); NaN if `trajectory` is null.
//
// # Safety
// `trajectory` is null or a motion that was not freed.
double kpam_trajectory_start(const struct kpam_trajectory *trajectory);

// Returns the end time of a motion (s); NaN if `trajectory` is null.
//
// # Safety
// `trajectory` is null or a motion that was not freed.
double kpam_trajectory_end(const struct kpam_trajectory *trajectory);

// Returns the number of entries of a joint vector; 0 if `trajectory` is null.
//
// # Safety
// `trajectory` is null or a motion that was not freed.
size_t kpam_trajectory_joints(const struct kpam_trajectory *trajectory);

// Writes position, velocity and acceleration at time `t` (s), `kpam_trajectory_joints` numbers each. Times before the
// start give the state at the start; after its end, the motion is at rest. The function takes no lock, and allocates
// no memory if it returns `KPAM_OK`.
//
// # Safety
// `trajectory` is null or a motion that was not freed; the other pointers are null or have room for
// `kpam_trajectory_joints` numbers each, and do not overlap.
enum kpam_status kpam_trajectory_sample_into(const struct kpam_trajectory *trajectory,
                                             double t,
                                             double *position,
                                             double *velocity,
                                             double *acceleration);

// Creates a stop that begins at time `t` (s) in the state of the motion and brakes along its path as hard as the
// limits of velocity, acceleration and jerk allow. If no stop along the path keeps the limits, for example just before
// the motion reverses, every joint stops independently as fast as it can, and the arm may leave the path. The stop may
// need more torque than the motion, and is not checked for collisions off the path.
//
// # Safety
// `trajectory` is null or a motion that was not freed; `out` can be written.
enum kpam_status kpam_trajectory_brake(const struct kpam_trajectory *trajectory,
                                       double t,
                                       struct kpam_trajectory **out);

// Creates the part of a motion from time `t` (s) on. Use it to keep a repeatedly spliced motion short.
//
// # Safety
// `trajectory` is null or a motion that was not freed; `out` can be written.
enum kpam_status kpam_trajectory_since(const struct kpam_trajectory *trajectory,
                                       double t,
                                       struct kpam_trajectory **out);

// Creates the motion that follows `trajectory` until time `t` (s) and `next` from then on. Both must have the same
// state at `t` (within 1e-6 in position, velocity and acceleration), and the same values of joints that neither motion
// moves.
//
// # Safety
// `trajectory` and `next` are null or motions that were not freed; `out` can be written.
enum kpam_status kpam_trajectory_splice(const struct kpam_trajectory *trajectory,
                                        const struct kpam_trajectory *next,
                                        double t,
                                        struct kpam_trajectory **out);

// Creates the fastest motion found through waypoints (`count` rows of `joints` numbers) within velocity, acceleration
// and jerk limits (`joints` numbers each). It begins at `start_time` with `start_velocity` and `start_acceleration`;
// null means at rest.
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

// Frees a motion; null is ignored.
//
// # Safety
// `trajectory` is null or a motion that was not freed.
void kpam_trajectory_free(struct kpam_trajectory *trajectory);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* GENSIM2_KPAM_H */
