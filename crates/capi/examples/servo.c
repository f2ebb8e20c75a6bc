/* Execute a planned motion at 1 kHz, brake in its middle, and continue to the goal.
 *
 *   cc -std=c11 -Iinclude examples/servo.c -L../../target/release -lgensim2_capi -lm -o servo
 *   ./servo ../../examples/robots/ur5e.urdf flange
 */
#define _POSIX_C_SOURCE 200809L
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#include "gensim2_kpam.h"

#define JOINTS 6
#define PERIOD_NS 1000000L

static void must(kpam_status status, const char *what)
{
    if (status != KPAM_OK) {
        fprintf(stderr, "%s: %s\n", what, kpam_last_error());
        exit(1);
    }
}

/* Returns the trajectory of a motion from rest at `start` to rest at `goal`. */
static kpam_trajectory *plan(const kpam_scene *scene, const double *start, const double *goal,
                             const kpam_options *options)
{
    kpam_motion *motion = NULL;
    kpam_trajectory *trajectory = NULL;
    must(kpam_plan_to_joints(scene, start, goal, 1, options, &motion), "plan");
    must(kpam_motion_trajectory(motion, &trajectory), "trajectory");
    kpam_motion_free(motion);
    return trajectory;
}

static double seconds(const struct timespec *from, const struct timespec *to)
{
    return (double)(to->tv_sec - from->tv_sec) + 1e-9 * (double)(to->tv_nsec - from->tv_nsec);
}

/* Samples the motion every millisecond from time `from` to `to` (s); returns the number of samples. */
static long drive(const kpam_trajectory *motion, double from, double to, double state[3][JOINTS], double *jump)
{
    struct timespec due, before, after;
    double last[JOINTS], slowest = 0.0;
    long ticks = (long)ceil((to - from) * 1e3);
    clock_gettime(CLOCK_MONOTONIC, &due);
    for (long k = 0; k <= ticks; k++) {
        double t = from + 1e-3 * (double)k;
        clock_gettime(CLOCK_MONOTONIC, &before);
        must(kpam_trajectory_sample_into(motion, t < to ? t : to, state[0], state[1], state[2]), "sample");
        clock_gettime(CLOCK_MONOTONIC, &after);
        if (seconds(&before, &after) > slowest) {
            slowest = seconds(&before, &after);
        }
        /* A real arm would receive the position state[0] or the velocity state[1] here. */
        for (int j = 0; j < JOINTS; j++) {
            if (k > 0 && fabs(state[0][j] - last[j]) > *jump) {
                *jump = fabs(state[0][j] - last[j]);
            }
            last[j] = state[0][j];
        }
        due.tv_nsec += PERIOD_NS;
        if (due.tv_nsec >= 1000000000L) {
            due.tv_nsec -= 1000000000L;
            due.tv_sec++;
        }
        clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &due, NULL);
    }
    printf("%ld samples, the slowest in %.1f us\n", ticks + 1, 1e6 * slowest);
    return ticks + 1;
}

int main(int count, char **arguments)
{
    if (count != 3) {
        fprintf(stderr, "usage: %s URDF HAND_LINK\n", arguments[0]);
        return 2;
    }
    kpam_scene *scene = NULL;
    must(kpam_scene_load(arguments[1], NULL, arguments[2], NULL, &scene), "load");
    if (kpam_scene_joints(scene) != JOINTS) {
        fprintf(stderr, "the arm has %zu joints, not %d\n", kpam_scene_joints(scene), JOINTS);
        return 1;
    }
    const double half[3] = {0.05, 0.3, 0.2};
    const double pose[16] = {1, 0, 0, 0.45, 0, 1, 0, 0.0, 0, 0, 1, 0.2, 0, 0, 0, 1};
    kpam_shape *box = NULL;
    must(kpam_shape_box(half, NULL, &box), "box");
    const kpam_shape *shapes[1] = {box};
    must(kpam_scene_add_body(scene, "wall", KPAM_ROLE_RIGID, shapes, 1, pose), "wall");
    kpam_shape_free(box);

    const double start[JOINTS] = {-1.0, -1.4, 1.5, -1.6, -1.57, 0.0};
    const double goal[JOINTS] = {1.0, -1.2, 1.4, -1.7, -1.57, 0.5};
    kpam_options options;
    must(kpam_options_init(&options, sizeof options), "options");
    options.limits = KPAM_LIMITS_PLAIN;
    options.margin = 0.01;
    options.velocity_scale = 0.5;
    kpam_trajectory *stop = NULL, *whole = NULL;
    kpam_trajectory *motion = plan(scene, start, goal, &options);
    printf("a motion of %.3f s\n", kpam_trajectory_end(motion));

    /* An obstacle appears halfway: brake as fast as possible, then plan from the stop to the goal. */
    double now = 0.5 * kpam_trajectory_end(motion), state[3][JOINTS], jump = 0.0;
    must(kpam_trajectory_brake(motion, now, &stop), "brake");
    must(kpam_trajectory_splice(motion, stop, now, &whole), "splice");
    drive(whole, 0.0, kpam_trajectory_end(whole), state, &jump);
    for (int j = 0; j < JOINTS; j++) {
        if (fabs(state[1][j]) > 1e-6 || fabs(state[2][j]) > 1e-6) {
            fprintf(stderr, "joint %d is not at rest\n", j);
            return 1;
        }
    }
    kpam_trajectory *on = plan(scene, state[0], goal, &options);
    drive(on, 0.0, kpam_trajectory_end(on), state, &jump);
    for (int j = 0; j < JOINTS; j++) {
        if (fabs(state[0][j] - goal[j]) > 1e-6) {
            fprintf(stderr, "joint %d ends at %.6f, not %.6f\n", j, state[0][j], goal[j]);
            return 1;
        }
    }
    printf("the greatest step in 1 ms was %.5f rad\n", jump);

    /* A failed call stores null and reports the reason. */
    kpam_motion *none = NULL;
    if (kpam_plan_to_joints(scene, NULL, goal, 1, &options, &none) != KPAM_INVALID || none != NULL) {
        return 1;
    }
    printf("refused: %s\n", kpam_last_error());
    kpam_trajectory_free(on);
    kpam_trajectory_free(whole);
    kpam_trajectory_free(stop);
    kpam_trajectory_free(motion);
    kpam_scene_free(scene);
    return jump < 0.01 ? 0 : 1;
}
