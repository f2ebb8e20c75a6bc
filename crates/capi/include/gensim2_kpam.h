#ifndef GENSIM2_KPAM_H
#define GENSIM2_KPAM_H

/* Made from crates/capi/src by cbindgen; `cargo test -p gensim2-capi` says where it is not current. */

#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>

// Status of a call.
typedef enum kpam_status {
    // As asked.
    KPAM_OK = 0,
    // There is no such motion, or none was found: the sentence says why.
    KPAM_NO_MOTION = 1,
    // An argument does not fit: the sentence names it.
    KPAM_INVALID = 2,
    // A file cannot be used: the sentence names file and field.
    KPAM_FILE = 3,
    // The solver failed; nothing was written. A mistake of the solver's that should be reported.
    KPAM_PANIC = 4,
} kpam_status;

// Limits of an arm, of which its URDF says nothing.
typedef enum kpam_limit_set {
    // 10 rad/s^2 and 5,000 rad/s^3 every joint.
    KPAM_LIMITS_PLAIN = 0,
    // As Franka publishes them for the Panda.
    KPAM_LIMITS_PANDA = 1,
    // As Franka publishes them for the Research 3, with velocity limits that depend on the position.
    KPAM_LIMITS_FR3 = 2,
} kpam_limit_set;

// A robot and what stands about it.
typedef struct kpam_scene kpam_scene;

// A timed motion of all joints.
typedef struct kpam_trajectory kpam_trajectory;

// Request for a motion; `kpam_options_default` fills it.
typedef struct kpam_options {
    // Distance (m) that everything keeps all along, 0 to 0.1.
    double margin;
    // Share of the velocity limits, above 0 to 1.
    double velocity_scale;
    // Share of the acceleration and jerk limits, above 0 to 1.
    double acceleration_scale;
    // Wall time (ms) after which the search ends; 0 for none.
    double deadline_ms;
    // Which samples are drawn.
    uint64_t seed;
    // A member of `kpam_limit_set`.
    uint32_t limits;
} kpam_options;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

// Sentence of the last call on this thread that did not return `KPAM_OK`; empty before there was one. Valid until the
// next such call on this thread.
const char *kpam_last_error(void);

// The defaults: 5 mm, all of the limits, no deadline, seed 0, plain limits.
struct kpam_options kpam_options_default(void);

// Reads a robot: its URDF, an SRDF that disables pairs of links (null for none), and the link that carries the tool.
//
// # Safety
// `urdf`, `srdf` and `hand_link` are null or strings that end with a zero; `out` may be written.
enum kpam_status kpam_scene_load(const char *urdf,
                                 const char *srdf,
                                 const char *hand_link,
                                 struct kpam_scene **out);

// Number of entries of a joint vector; 0 for null.
//
// # Safety
// `scene` is null or a scene that was not freed.
size_t kpam_scene_joints(const struct kpam_scene *scene);

// Adds a box that stands: its half extents (3 numbers, m) and pose (16 numbers, rows, base frame).
//
// # Safety
// `scene` is null or a scene that was not freed and that no other thread uses now; `name` is null or a string that ends
// with a zero; `half_extents` and `pose` are null or point at as many numbers.
enum kpam_status kpam_scene_add_box(struct kpam_scene *scene,
                                    const char *name,
                                    const double *half_extents,
                                    const double *pose);

// Plans a timed motion from rest at `q_start` to rest at `q_goal`, clear by the margin all along. Each has
// `kpam_scene_joints` entries; `options` may be null.
//
// # Safety
// `scene` is null or a scene that was not freed; `q_start` and `q_goal` are null or point at that many numbers;
// `options` is null or can be read; `out` may be written.
enum kpam_status kpam_plan_joints(const struct kpam_scene *scene,
                                  const double *q_start,
                                  const double *q_goal,
                                  const struct kpam_options *options,
                                  struct kpam_trajectory **out);

// Frees a scene; null is nothing.
//
// # Safety
// `scene` is null or a scene that was not freed.
void kpam_scene_free(struct kpam_scene *scene);

// Time of the start (s); not a number for null.
//
// # Safety
// `trajectory` is null or a motion that was not freed.
double kpam_trajectory_start(const struct kpam_trajectory *trajectory);

// Time of the end (s); not a number for null.
//
// # Safety
// `trajectory` is null or a motion that was not freed.
double kpam_trajectory_end(const struct kpam_trajectory *trajectory);

// Number of entries of a joint vector; 0 for null.
//
// # Safety
// `trajectory` is null or a motion that was not freed.
size_t kpam_trajectory_joints(const struct kpam_trajectory *trajectory);

// Writes position, velocity and acceleration at time `t` (s), `kpam_trajectory_joints` numbers each: as at the start
// before it, at rest after the end. Allocates nothing where it returns `KPAM_OK`, and takes no lock.
//
// # Safety
// `trajectory` is null or a motion that was not freed; the others are null or have room for that many numbers, and do
// not overlap.
enum kpam_status kpam_trajectory_sample_into(const struct kpam_trajectory *trajectory,
                                             double t,
                                             double *position,
                                             double *velocity,
                                             double *acceleration);

// Makes a stop from the state at time `t` (s) on, along the motion's own path: at every place it brakes as hard as the
// limits of velocity, acceleration and jerk allow. It begins at `t`. Where no such stop keeps the limits, as right before the
// motion turns back, every joint stops by itself as soon as it can, which may lead off the path. The stop may need more
// torque than the motion; nothing checks it for collisions off the path.
//
// # Safety
// `trajectory` is null or a motion that was not freed; `out` may be written.
enum kpam_status kpam_trajectory_brake(const struct kpam_trajectory *trajectory,
                                       double t,
                                       struct kpam_trajectory **out);

// Makes the motion that is `trajectory` from time `t` on: a stream that is spliced again and again stays small by this.
//
// # Safety
// `trajectory` is null or a motion that was not freed; `out` may be written.
enum kpam_status kpam_trajectory_since(const struct kpam_trajectory *trajectory,
                                       double t,
                                       struct kpam_trajectory **out);

// Makes the motion that is `trajectory` until time `t` and `next` from there on. Both are in the same state at `t`, to
// 1e-6 in position, velocity and acceleration, and joints that neither moves stand where they do.
//
// # Safety
// `trajectory` and `next` are null or motions that were not freed; `out` may be written.
enum kpam_status kpam_trajectory_splice(const struct kpam_trajectory *trajectory,
                                        const struct kpam_trajectory *next,
                                        double t,
                                        struct kpam_trajectory **out);

// Makes the fastest motion found through waypoints (`count` rows of `joints` numbers) within velocity, acceleration and
// jerk limits (`joints` numbers each). It begins at `start_time` with `start_velocity` and `start_acceleration`; null is
// at rest.
//
// # Safety
// All pointers but `out` are null or point at as many numbers; `out` may be written.
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

// Frees a motion; null is nothing.
//
// # Safety
// `trajectory` is null or a motion that was not freed.
void kpam_trajectory_free(struct kpam_trajectory *trajectory);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* GENSIM2_KPAM_H */
