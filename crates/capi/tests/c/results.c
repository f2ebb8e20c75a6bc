/* Prints results of the interface, one line each: a word, then numbers or names. tests/results.rs computes the same lines
 * with the Rust crates. */
#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "gensim2_kpam.h"

#define JOINTS 6

static void must(kpam_status status)
{
    if (status != KPAM_OK) {
        fprintf(stderr, "status %d: %s\n", status, kpam_last_error());
        exit(1);
    }
}

static void print(const char *word, const double *numbers, size_t count)
{
    printf("%s", word);
    for (size_t k = 0; k < count; k++) {
        printf(" %.17g", numbers[k]);
    }
    printf("\n");
}

static void add(kpam_scene *scene, const char *name, kpam_role role, kpam_shape *shape, double x, double y, double z)
{
    const double pose[16] = {1, 0, 0, x, 0, 1, 0, y, 0, 0, 1, z, 0, 0, 0, 1};
    const kpam_shape *shapes[1] = {shape};
    must(kpam_scene_add_body(scene, name, role, shapes, 1, pose));
    kpam_shape_free(shape);
}

static void surroundings(kpam_scene *scene, const double *q)
{
    double distances[2];
    bool hits[2];
    kpam_pairs *pairs = NULL;
    const kpam_pair *pair;
    must(kpam_scene_distance(scene, q, 2, 1.0, distances));
    print("distance", distances, 2);
    must(kpam_scene_in_collision(scene, q, 2, hits));
    printf("hits %d %d\n", hits[0], hits[1]);
    must(kpam_scene_check(scene, q, 0.2, &pairs));
    for (size_t k = 0; (pair = kpam_pairs_at(pairs, k)) != NULL; k++) {
        const double numbers[4] = {pair->distance, pair->point[0], pair->point[1], pair->point[2]};
        printf("%s | %s ", pair->first, pair->second);
        print("|", numbers, 4);
    }
    kpam_pairs_free(pairs);
}

static void motion(const char *word, kpam_motion *planned)
{
    kpam_trajectory *trajectory = NULL;
    double state[3][JOINTS];
    must(kpam_motion_trajectory(planned, &trajectory));
    const double start = kpam_trajectory_start(trajectory), end = kpam_trajectory_end(trajectory);
    printf("%s %zu\n", word, kpam_motion_goal(planned));
    for (size_t k = 0; kpam_motion_warning(planned, k) != NULL; k++) {
        printf("warning %s\n", kpam_motion_warning(planned, k));
    }
    for (size_t k = 0; kpam_motion_assumed_limit(planned, k) != NULL; k++) {
        printf("assumed %s\n", kpam_motion_assumed_limit(planned, k));
    }
    kpam_motion_free(planned);
    for (int k = 0; k <= 4; k++) {
        const double t = start + 0.25 * k * (end - start);
        must(kpam_trajectory_sample_into(trajectory, t, state[0], state[1], state[2]));
        print("state", &state[0][0], 3 * JOINTS);
    }
    kpam_trajectory_free(trajectory);
}

/* Prints the status of a call that stores nothing in `planned`, which is not null before. */
#define FAILS(call)                                                                                                  \
    do {                                                                                                             \
        planned = (kpam_motion *)&options;                                                                           \
        const kpam_status status = (call);                                                                           \
        printf("failure %d %s %s\n", status, planned == NULL ? "null" : "not null", kpam_last_error());              \
    } while (0)

int main(int count, char **arguments)
{
    if (count != 3) {
        return 2;
    }
    kpam_scene *scene = NULL;
    must(kpam_scene_load(arguments[1], NULL, "flange", NULL, &scene));
    printf("version %s %u\n", kpam_version(), kpam_abi_version());
    const size_t n = kpam_scene_joints(scene);
    if (n != JOINTS) {
        return 1;
    }
    double limits[6][JOINTS];
    must(kpam_scene_joint_limits(scene, limits[0], limits[1], limits[2], limits[3], limits[4], limits[5]));
    print("limits", &limits[0][0], 6 * JOINTS);
    for (size_t k = 0; kpam_scene_joint_name(scene, k) != NULL; k++) {
        printf("joint %s\n", kpam_scene_joint_name(scene, k));
    }
    for (size_t k = 0; kpam_scene_link_name(scene, k) != NULL; k++) {
        printf("link %s\n", kpam_scene_link_name(scene, k));
    }

    const double q[2][JOINTS] = {{0.1, -1.2, 1.5, -1.9, -1.6, 0.3}, {-1.2, -1.0, 1.3, -1.7, -1.5, 0.4}};
    double pose[16], jacobian[6 * JOINTS], second[16];
    must(kpam_scene_forward_kinematics(scene, q[0], NULL, pose));
    print("pose", pose, 16);
    must(kpam_scene_forward_kinematics(scene, q[1], "forearm_link", second));
    print("pose", second, 16);
    must(kpam_scene_jacobian(scene, q[0], NULL, jacobian));
    print("jacobian", jacobian, 6 * JOINTS);
    must(kpam_scene_jacobian(scene, q[1], "wrist_1_link", jacobian));
    print("jacobian", jacobian, 6 * JOINTS);

    kpam_ik_options ik;
    double solutions[8 * JOINTS];
    size_t found = 77;
    must(kpam_ik_options_init(&ik, sizeof ik));
    must(kpam_scene_ik(scene, pose, q[1], NULL, 8, solutions, &found));
    print("ik", solutions, found * JOINTS);
    ik.link = "wrist_2_link";
    ik.margin = 0.0;
    ik.seed = 3;
    ik.min_distance = 0.2;
    ik.posture = q[0];
    ik.manipulability = 0.5;
    must(kpam_scene_forward_kinematics(scene, q[0], "wrist_2_link", second));
    must(kpam_scene_ik(scene, second, q[1], &ik, 3, solutions, &found));
    print("ik", solutions, found * JOINTS);
    second[3] = 5.0;
    must(kpam_scene_ik(scene, second, q[1], &ik, 3, solutions, &found));
    print("ik", solutions, found * JOINTS);

    /* One body of each kind of shape. */
    const double half[3] = {0.05, 0.1, 0.2}, center[3] = {0.0, 0.0, 0.1};
    const double turned[16] = {0, 0, 1, 0, 0, 1, 0, 0, -1, 0, 0, 0, 0, 0, 0, 1};
    const double corners[4][3] = {{0, 0, 0}, {0.1, 0, 0}, {0, 0.1, 0}, {0, 0, 0.1}};
    const uint32_t facets[2][3] = {{0, 1, 2}, {0, 2, 3}};
    const double scale[3] = {0.001, 0.002, 0.001};
    kpam_shape *shape = NULL;
    must(kpam_shape_box(half, turned, &shape));
    add(scene, "box", KPAM_ROLE_RIGID, shape, 0.75, 0.1, 0.1);
    must(kpam_shape_sphere(0.07, center, &shape));
    add(scene, "sphere", KPAM_ROLE_RIGID, shape, 0.6, 0.4, 0.2);
    must(kpam_shape_capsule(0.03, 0.3, turned, &shape));
    add(scene, "capsule", KPAM_ROLE_RIGID, shape, 0.6, 0.2, 0.1);
    must(kpam_shape_cylinder(0.03, 0.3, NULL, &shape));
    add(scene, "cylinder", KPAM_ROLE_RIGID, shape, 0.75, 0.3, 0.2);
    must(kpam_shape_convex_hull(&corners[0][0], 4, &shape));
    add(scene, "hull", KPAM_ROLE_RIGID, shape, 0.55, -0.1, 0.1);
    must(kpam_shape_mesh(&corners[0][0], 4, &facets[0][0], 2, &shape));
    add(scene, "mesh", KPAM_ROLE_RIGID, shape, 0.75, -0.2, 0.3);
    must(kpam_shape_hull_of_file(arguments[2], scale, &shape));
    add(scene, "file", KPAM_ROLE_RIGID, shape, 0.4, -0.2, 0.2);
    must(kpam_shape_point_cloud(&corners[0][0], 4, 0.01, &shape));
    add(scene, "cloud", KPAM_ROLE_RIGID, shape, 0.5, 0.0, 0.0);
    must(kpam_shape_box(half, NULL, &shape));
    add(scene, "part", KPAM_ROLE_RIGID, shape, 0.0, -0.7, 0.2);
    surroundings(scene, q[0]);

    /* A copy keeps its bodies while the scene changes. */
    kpam_scene *copy = NULL;
    const double there[16] = {1, 0, 0, 0.1, 0, 1, 0, -0.8, 0, 0, 1, 0.3, 0, 0, 0, 1};
    must(kpam_scene_copy(scene, &copy));
    must(kpam_scene_remove_body(scene, "mesh"));
    must(kpam_scene_move_body(scene, "part", there));
    must(kpam_scene_attach(scene, "part", q[1]));
    must(kpam_scene_body_pose(scene, "part", second));
    print("attached", second, 16);
    surroundings(scene, q[0]);
    must(kpam_scene_detach(scene, "part", q[0]));
    must(kpam_scene_body_pose(scene, "part", second));
    print("detached", second, 16);
    must(kpam_scene_move_body(scene, "part", there));
    for (size_t k = 0; kpam_scene_body_name(scene, k) != NULL; k++) {
        printf("body %s\n", kpam_scene_body_name(scene, k));
    }
    surroundings(copy, q[0]);
    kpam_scene_free(copy);

    bool is_own[4];
    must(kpam_scene_forward_kinematics(scene, q[0], NULL, pose));
    const double cloud[4][3] = {{0, 0, 0.5}, {pose[3], pose[7], pose[11]}, {2, 0, 0}, {0, 0, 0.1}};
    must(kpam_scene_own_points(scene, q[0], &cloud[0][0], 4, 0.02, is_own));
    printf("own %d %d %d %d\n", is_own[0], is_own[1], is_own[2], is_own[3]);

    /* Motions. The first goal lies in the box. */
    kpam_options options;
    kpam_motion *planned = NULL;
    double goals[3][JOINTS], poses[3][16];
    must(kpam_options_init(&options, sizeof options));
    options.seed = 4;
    options.margin = 0.004;
    options.velocity_scale = 0.5;
    for (int k = 0; k < 3; k++) {
        memcpy(goals[k], q[k == 0 ? 0 : 1], sizeof goals[k]);
        goals[k][5] += 0.2 * k;
        must(kpam_scene_forward_kinematics(scene, goals[k], NULL, poses[k]));
    }
    must(kpam_shape_box(half, NULL, &shape));
    add(scene, "block", KPAM_ROLE_RIGID, shape, poses[0][3], poses[0][7], poses[0][11]);
    const double home[JOINTS] = {1.5, -1.4, 1.5, -1.7, -1.57, 0.0};
    must(kpam_plan_to_joints(scene, home, goals[0], 3, &options, &planned));
    motion("joints", planned);
    options.limits = KPAM_LIMITS_PLAIN;
    must(kpam_plan_to_poses(scene, home, poses[0], 3, NULL, &options, &planned));
    motion("poses", planned);

    kpam_path_tolerance tolerance;
    const double axis[3] = {0, 0, 1};
    must(kpam_path_tolerance_init(&tolerance, sizeof tolerance));
    tolerance.position = 0.002;
    tolerance.rotation = 0.05;
    tolerance.free_axis = axis;
    double line[2][16];
    must(kpam_scene_forward_kinematics(scene, home, NULL, line[0]));
    memcpy(line[1], line[0], sizeof line[0]);
    line[0][11] += 0.05;
    line[1][11] += 0.05;
    line[1][7] += 0.05;
    must(kpam_plan_along(scene, home, line[0], 2, &tolerance, &options, &planned));
    motion("along", planned);

    /* Replanning from a moving state, with the current motion. */
    kpam_trajectory *current = NULL;
    double state[3][JOINTS];
    must(kpam_plan_to_joints(scene, home, goals[1], 1, &options, &planned));
    must(kpam_motion_trajectory(planned, &current));
    kpam_motion_free(planned);
    options.start_time = 0.3;
    must(kpam_trajectory_sample_into(current, options.start_time, state[0], state[1], state[2]));
    options.start_velocity = state[1];
    options.start_acceleration = state[2];
    options.warm_start = current;
    const double fast[JOINTS] = {3, 3, 3, 3, 3, 3}, hard[JOINTS] = {8, 8, 8, 8, 8, 8};
    const double jerk[JOINTS] = {4e3, 4e3, 4e3, 4e3, 4e3, 4e3};
    options.velocity_limits = fast;
    options.acceleration_limits = hard;
    options.jerk_limits = jerk;
    options.velocity_scale = 1.0;
    must(kpam_plan_to_joints(scene, state[0], goals[2], 1, &options, &planned));
    motion("moving", planned);

    /* Failures. Each one leaves null. */
    kpam_cancel *cancel = NULL;
    must(kpam_cancel_create(&cancel));
    must(kpam_options_init(&options, sizeof options));
    options.cancel = cancel;
    FAILS(kpam_plan_to_joints(scene, home, goals[0], 1, &options, &planned));
    FAILS(kpam_plan_to_joints(scene, goals[0], home, 1, &options, &planned));
    line[0][3] = 4.0;
    FAILS(kpam_plan_to_poses(scene, home, line[0], 1, NULL, &options, &planned));
    FAILS(kpam_plan_along(scene, home, line[0], 2, NULL, &options, &planned));
    kpam_cancel_set(cancel);
    printf("cancelled %d\n", kpam_cancel_is_set(cancel));
    FAILS(kpam_plan_to_joints(scene, home, goals[1], 1, &options, &planned));
    options.cancel = NULL;
    options.deadline_ms = 1e-6;
    FAILS(kpam_plan_to_joints(scene, home, goals[1], 1, &options, &planned));
    options.deadline_ms = 0.0;
    line[0][0] = NAN;
    FAILS(kpam_plan_to_poses(scene, home, line[1], 1, "no_link", &options, &planned));
    FAILS(kpam_plan_to_poses(scene, home, line[0], 2, NULL, &options, &planned));

    kpam_cancel_free(cancel);
    kpam_trajectory_free(current);
    kpam_scene_free(scene);
    return 0;
}
