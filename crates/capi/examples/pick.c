/* Pick a part with a suction cup and place it behind a wall that a camera saw.
 *
 * The program loads an arm, makes obstacles of a point cloud, solves inverse kinematics, plans to poses and along lines,
 * attaches and detaches the part, replans while the arm moves, and cancels a search from another thread.
 *
 *   cc -std=c11 -Iinclude examples/pick.c -L../../target/release -lgensim2_capi -lm -lpthread -o pick
 *   ./pick ../../examples/robots/ur5e.urdf
 */
#define _POSIX_C_SOURCE 200809L
#include <math.h>
#include <pthread.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "gensim2_kpam.h"

#define JOINTS 6
#define POINTS 10000
#define CUP 0.1    /* length of the suction cup, m */
#define HALF 0.03  /* half the edge of the part, a cube, m */
#define GAP 0.002  /* distance between cup and part when the vacuum is switched on, m */

static void must(kpam_status status, const char *what)
{
    if (status != KPAM_OK) {
        fprintf(stderr, "%s: %s\n", what, kpam_last_error());
        exit(1);
    }
}

/* Writes the pose of a flange that points down at (x, y, z), turned by `turn` (rad) about the vertical. */
static void pointing_down(double x, double y, double z, double turn, double pose[16])
{
    const double c = cos(turn), s = sin(turn);
    const double rows[16] = {c, s, 0, x, s, -c, 0, y, 0, 0, -1, z, 0, 0, 0, 1};
    memcpy(pose, rows, sizeof rows);
}

/* Adds a body of one shape, and frees the shape. `pose` may be null. */
static void add(kpam_scene *scene, const char *name, kpam_role role, kpam_shape *shape, const double *pose)
{
    const kpam_shape *shapes[1] = {shape};
    must(kpam_scene_add_body(scene, name, role, shapes, 1, pose), name);
    kpam_shape_free(shape);
}

/* Returns the number of points (m, base frame) of a table and a wall, as a calibrated depth camera would see them. The
 * table under the part is hidden from the camera. */
static size_t camera(double part_x, double part_y, double *points)
{
    size_t count = 0;
    for (int i = -35; i <= 35; i++) {
        for (int k = -35; k <= 35; k++) {
            const double x = 0.02 * i, y = 0.02 * k;
            if (fabs(x - part_x) > HALF + 0.01 || fabs(y - part_y) > HALF + 0.01) {
                const double point[3] = {x, y, -0.01};
                memcpy(points + 3 * count++, point, sizeof point);
            }
        }
    }
    for (int i = 0; i < 25; i++) {
        for (int k = 0; k < 13; k++) {
            const double point[3] = {0.25 + 0.02 * i, 0.0, 0.02 * k};
            memcpy(points + 3 * count++, point, sizeof point);
        }
    }
    return count;
}

/* Sends a trajectory to the arm between two times (s); the last state remains in `state`: position, velocity,
 * acceleration. */
static void execute(const kpam_trajectory *trajectory, double from, double to, double state[3][JOINTS])
{
    for (double t = from; t < to; t += 1e-3) {
        must(kpam_trajectory_sample_into(trajectory, t, state[0], state[1], state[2]), "sample");
        /* A real controller sends state[0] here and waits for the next millisecond. */
    }
    must(kpam_trajectory_sample_into(trajectory, to, state[0], state[1], state[2]), "sample");
}

/* Executes a planned motion from its start to its end, frees it, and writes the joints at its end to `q`. */
static void run(const char *name, kpam_motion *motion, double q[JOINTS])
{
    kpam_trajectory *trajectory = NULL;
    double state[3][JOINTS];
    must(kpam_motion_trajectory(motion, &trajectory), name);
    printf("%s: %.2f s, goal %zu\n", name, kpam_trajectory_end(trajectory), kpam_motion_goal(motion));
    execute(trajectory, 0.0, kpam_trajectory_end(trajectory), state);
    memcpy(q, state[0], sizeof state[0]);
    kpam_trajectory_free(trajectory);
    kpam_motion_free(motion);
}

/* Cancels a search after 50 ms, as an operator or a supervisor would. */
static void *operator_thread(void *cancel)
{
    const struct timespec pause = {0, 50000000L};
    nanosleep(&pause, NULL);
    kpam_cancel_set(cancel);
    return NULL;
}

int main(int count, char **arguments)
{
    if (count != 2) {
        fprintf(stderr, "usage: %s UR5E_URDF\n", arguments[0]);
        return 2;
    }
    if (kpam_abi_version() != KPAM_ABI_VERSION) {
        fprintf(stderr, "the library has another version, %s: compile again\n", kpam_version());
        return 1;
    }

    /* The arm. A joint vector has one number for each of these joints. */
    kpam_scene *scene = NULL;
    must(kpam_scene_load(arguments[1], NULL, "flange", NULL, &scene), "load");
    double lower[JOINTS], upper[JOINTS];
    if (kpam_scene_joints(scene) != JOINTS) {
        fprintf(stderr, "the arm has %zu joints, not %d\n", kpam_scene_joints(scene), JOINTS);
        return 1;
    }
    must(kpam_scene_joint_limits(scene, lower, upper, NULL, NULL, NULL, NULL), "limits");
    for (size_t j = 0; j < JOINTS; j++) {
        printf("%s: %.2f to %.2f rad\n", kpam_scene_joint_name(scene, j), lower[j], upper[j]);
    }
    const double home[JOINTS] = {0.0, -1.2, 1.5, -1.9, -1.6, 0.0};
    double q[JOINTS];
    memcpy(q, home, sizeof home);

    /* The tool, fixed to the flange: a cylinder along its z axis. */
    kpam_shape *shape = NULL;
    const double cup_pose[16] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0.5 * CUP, 0, 0, 0, 1};
    must(kpam_shape_cylinder(0.015, CUP, NULL, &shape), "cup");
    add(scene, "cup", KPAM_ROLE_ATTACHED, shape, cup_pose);

    /* The surroundings: points that the camera saw, without those on the robot itself, each a sphere of 10 mm. */
    const double x = 0.45, y = 0.25;
    static double points[3 * POINTS];
    static bool is_own[POINTS];
    size_t seen = camera(x, y, points), kept = 0;
    must(kpam_scene_own_points(scene, q, points, seen, 0.03, is_own), "own points");
    for (size_t k = 0; k < seen; k++) {
        if (!is_own[k]) {
            memmove(points + 3 * kept++, points + 3 * k, 3 * sizeof points[0]);
        }
    }
    printf("%zu of %zu points are obstacles\n", kept, seen);
    must(kpam_shape_point_cloud(points, kept, 0.01, &shape), "cloud");
    add(scene, "cloud", KPAM_ROLE_RIGID, shape, NULL);

    /* The part, a cube on the table. */
    const double half[3] = {HALF, HALF, HALF};
    const double part_pose[16] = {1, 0, 0, x, 0, 1, 0, y, 0, 0, 1, HALF, 0, 0, 0, 1};
    must(kpam_shape_box(half, NULL, &shape), "part");
    add(scene, "part", KPAM_ROLE_RIGID, shape, part_pose);

    /* Is there room at home? The list names the pairs that are closer than 20 mm, closest first. */
    kpam_pairs *pairs = NULL;
    const kpam_pair *pair;
    must(kpam_scene_check(scene, q, 0.02, &pairs), "check");
    for (size_t k = 0; (pair = kpam_pairs_at(pairs, k)) != NULL; k++) {
        printf("%s and %s: %.1f mm\n", pair->first, pair->second, 1e3 * pair->distance);
    }
    kpam_pairs_free(pairs);

    /* Inverse kinematics: all arm postures that hold the cup 100 mm above the part without a collision. */
    const double touch = 2.0 * HALF + GAP + CUP, high = touch + 0.1;
    double above[4][16], solutions[256 * JOINTS];
    for (int k = 0; k < 4; k++) {
        pointing_down(x, y, high, 1.5707963267948966 * k, above[k]);
    }
    kpam_ik_options ik;
    size_t found = 0;
    must(kpam_ik_options_init(&ik, sizeof ik), "options");
    ik.margin = 0.005;
    must(kpam_scene_ik(scene, above[0], q, &ik, 256, solutions, &found), "ik");
    printf("%zu postures above the part\n", found);

    /* Go above the part, with whichever of the four rotations about the vertical is easiest to reach. */
    kpam_options options;
    must(kpam_options_init(&options, sizeof options), "options");
    options.deadline_ms = 60000.0;
    kpam_motion *motion = NULL;
    must(kpam_plan_to_poses(scene, q, above[0], 4, NULL, &options, &motion), "to the part");
    for (size_t k = 0; kpam_motion_warning(motion, k) != NULL; k++) {
        printf("warning: %s\n", kpam_motion_warning(motion, k));
    }
    const double turn = 1.5707963267948966 * (double)kpam_motion_goal(motion);
    run("to the part", motion, q);
    options.limits = KPAM_LIMITS_PLAIN; /* The defaults are right for this arm: no more warnings. */

    /* Straight down, grasp, and straight up. From the attachment on, the part belongs to the arm. */
    double pose[16];
    pointing_down(x, y, touch, turn, pose);
    must(kpam_plan_along(scene, q, pose, 1, NULL, &options, &motion), "down");
    run("down", motion, q);
    must(kpam_scene_attach(scene, "part", q), "attach");
    pointing_down(x, y, high, turn, pose);
    must(kpam_plan_along(scene, q, pose, 1, NULL, &options, &motion), "up");
    run("up", motion, q);

    /* Around the wall, down, release 6 mm above the table, and up. */
    pointing_down(x, -y, high, turn, pose);
    must(kpam_plan_to_poses(scene, q, pose, 1, NULL, &options, &motion), "around the wall");
    run("around the wall", motion, q);
    pointing_down(x, -y, touch + 0.006, turn, pose);
    must(kpam_plan_along(scene, q, pose, 1, NULL, &options, &motion), "place");
    run("place", motion, q);
    must(kpam_scene_detach(scene, "part", q), "detach");
    must(kpam_scene_body_pose(scene, "part", pose), "part");
    printf("the part is at %.3f, %.3f, %.3f m\n", pose[3], pose[7], pose[11]);
    if (fabs(pose[3] - x) > 0.003 || fabs(pose[7] + y) > 0.003 || fabs(pose[11] - HALF - 0.006) > 0.003) {
        return 1;
    }
    pointing_down(x, -y, high, turn, pose);
    must(kpam_plan_along(scene, q, pose, 1, NULL, &options, &motion), "retreat");
    run("retreat", motion, q);

    /* Go home, but halfway there is a new goal: plan from the moving state, and join the two motions. */
    kpam_trajectory *going = NULL, *again = NULL, *whole = NULL;
    double state[3][JOINTS], goal[JOINTS];
    must(kpam_plan_to_joints(scene, q, home, 1, &options, &motion), "home");
    must(kpam_motion_trajectory(motion, &going), "home");
    kpam_motion_free(motion);
    const double now = 0.5 * kpam_trajectory_end(going);
    execute(going, 0.0, now, state);
    memcpy(goal, home, sizeof home);
    goal[0] -= 0.4;
    options.start_velocity = state[1];
    options.start_acceleration = state[2];
    options.start_time = now;
    must(kpam_plan_to_joints(scene, state[0], goal, 1, &options, &motion), "new goal");
    must(kpam_motion_trajectory(motion, &again), "new goal");
    kpam_motion_free(motion);
    must(kpam_trajectory_splice(going, again, now, &whole), "splice");
    printf("new goal: %.2f s\n", kpam_trajectory_end(whole));
    execute(whole, now, kpam_trajectory_end(whole), state);
    memcpy(q, state[0], sizeof q);

    /* Two walls cut the room in half, so that this search cannot succeed. Another thread cancels it. */
    kpam_scene *room = NULL;
    const double slab[3] = {0.6, 0.005, 1.0};
    must(kpam_scene_copy(scene, &room), "copy");
    must(kpam_scene_remove_body(room, "cloud"), "remove");
    for (int k = 0; k < 2; k++) {
        const double at = k == 0 ? 0.75 : -0.75;
        const double wall_pose[16] = {1, 0, 0, at, 0, 1, 0, 0, 0, 0, 1, 1.0, 0, 0, 0, 1};
        must(kpam_shape_box(slab, NULL, &shape), "wall");
        add(room, k == 0 ? "wall in front" : "wall behind", KPAM_ROLE_RIGID, shape, wall_pose);
    }
    kpam_cancel *cancel = NULL;
    pthread_t thread;
    must(kpam_cancel_create(&cancel), "cancel");
    kpam_options hopeless;
    must(kpam_options_init(&hopeless, sizeof hopeless), "options");
    hopeless.cancel = cancel;
    hopeless.samples = 1000000000;
    const double left[JOINTS] = {0.7, -1.4, 1.5, -1.7, -1.57, 0.0}, right[JOINTS] = {-2.2, -1.4, 1.5, -1.7, -1.57, 0.0};
    if (pthread_create(&thread, NULL, operator_thread, cancel) != 0) {
        return 1;
    }
    const kpam_status status = kpam_plan_to_joints(room, left, right, 1, &hopeless, &motion);
    pthread_join(thread, NULL);
    printf("cancelled: %s\n", kpam_last_error());
    if (status != KPAM_CANCELLED || motion != NULL) {
        return 1;
    }
    kpam_cancel_free(cancel);
    kpam_scene_free(room);
    kpam_trajectory_free(whole);
    kpam_trajectory_free(again);
    kpam_trajectory_free(going);
    kpam_scene_free(scene);
    return 0;
}
