"""Lists of fast and slow test files."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TypeVar

import pytest

TESTS = Path(__file__).parents[1]

#: ``pytest -m fast`` runs these files: almost no simulation, no worker processes and no training.
FAST = (
    "core/test_errors.py",
    "core/test_files.py",
    "test_rooms.py",
    "bench/test_checker.py",
    "bench/test_motion.py",
    "bench/test_problems.py",
    "bench/test_results_table.py",
    "bench/test_scene.py",
    "bench/test_solver.py",
    "cli/test_report.py",
    "cli/test_tasks.py",
    "data/test_clearance.py",
    "data/test_store.py",
    "robot/test_log.py",
    "robot/test_streaming.py",
    "robot/test_watch.py",
    "design/runs/test_adding.py",
    "design/runs/test_remembering.py",
    "design/runs/test_search.py",
    "design/sandbox/test_hostile.py",
    "design/sandbox/test_task_code.py",
    "design/test_steering.py",
    "data/test_films.py",
    "inspection/test_rigid.py",
    "instructions/test_grammar.py",
    "kpam/test_arms.py",
    "kpam/test_collision.py",
    "kpam/test_config.py",
    "kpam/test_continuous.py",
    "kpam/test_drawer.py",
    "kpam/test_grasps.py",
    "kpam/test_kinematics.py",
    "kpam/test_letting_go.py",
    "kpam/test_mimic.py",
    "kpam/test_moving_starts.py",
    "kpam/test_path.py",
    "kpam/test_plan.py",
    "kpam/test_reach.py",
    "kpam/test_surface.py",
    "kpam/test_timing.py",
    "objects/test_clearance.py",
    "objects/test_export.py",
    "objects/test_names.py",
    "objects/test_pieces.py",
    "objects/test_rigid.py",
    "objects/test_rigid_damage.py",
    "objects/test_rotations.py",
    "objects/test_words.py",
    "perception/test_cloud.py",
    "perception/test_noise.py",
    "planning/test_actions.py",
    "planning/test_landmarks.py",
    "planning/test_reaching.py",
    "planning/test_shortening.py",
    "planning/test_steps.py",
    "planning/test_strategies.py",
    "policy/experiments/test_figures.py",
    "policy/test_array_file.py",
    "policy/test_config.py",
    "policy/test_encoders.py",
    "policy/test_numerics.py",
    "policy/test_symmetry.py",
    "robots/test_arm.py",
    "robots/test_profiles.py",
    "rollout/test_attempts.py",
    "rollout/test_causes.py",
    "rollout/test_diagnose.py",
    "rollout/test_noise.py",
    "rollout/test_rates.py",
    "rollout/test_room.py",
    "rollout/test_run.py",
    "rollout/test_verdicts.py",
    "ros/test_package.py",
    "ros/test_world.py",
    "scenes/test_one_spelling.py",
    "scenes/test_physics_switches.py",
    "scenes/test_randomize.py",
    "sim/test_grip.py",
    "sim/test_lazy_mapping.py",
    "sim/test_objects.py",
    "tasks/test_archives.py",
    "tasks/test_criteria.py",
    "tasks/test_designed.py",
    "tasks/test_library.py",
)

#: Files of which only marked tests are fast.
PARTLY_FAST = (
    "examples/test_examples.py",
    "fuzz/test_readers.py",
    "kill/test_kills.py",
    "pages/test_pages.py",
    "core/processes/test_pool.py",
)

#: Evaluations run episodes, and real objects are prepared, both for seconds each.
SLOW_ROOMS = ("evaluation", "real")

#: Skips that continuous integration (``CI=true``) accepts, with the reason. A key is the path of a file below
#: ``tests/``, or the id of a class or test. Any other skip fails there.
SKIPPED_IN_CI: dict[str, str] = {}

#: The slowest files, which are started first so that no core waits for one of them at the end.
LONGEST = (
    "kill/test_trainings.py",
    "policy/test_builtin.py",
    "policy/experiments/test_experiment.py",
    "policy/test_hostile_folders.py",
    "policy/test_replicas.py",
    "test_packaging.py",
    "design/runs/test_models_in_physics.py",
    "fuzz/test_readers.py",
    "kill/test_kills.py",
    "kpam/test_recheck.py",
    "real/test_sim_real.py",
    "examples/test_examples.py",
    "real/test_assets_real.py",
    "sim/test_headless.py",
    "policy/test_train.py",
    "design/runs/test_benchmarking.py",
    "tasks/test_library_strategies.py",
    "robot/test_processes.py",
    "robot/test_stopped_devices.py",
    "data/test_foreign.py",
    "pages/test_pages.py",
    "core/processes/test_ray.py",
    "sim/test_env.py",
    "objects/test_interior.py",
    "policy/test_export.py",
    "real/test_rigid_real.py",
    "pages/test_viewing.py",
    "design/runs/test_models.py",
    "data/test_collection.py",
    "rollout/test_trajectory.py",
    "sim/test_initial_state.py",
    "sim/test_gymnasium.py",
    "objects/test_generated.py",
    "robot/test_line.py",
    "kill/test_night.py",
    "policy/keypose/test_learn.py",
)


def place(file: Path) -> str:
    """Return the path of a test file relative to ``tests/``."""
    return file.relative_to(TESTS).as_posix() if file.is_relative_to(TESTS) else file.as_posix()


Report = TypeVar("Report", pytest.TestReport, pytest.CollectReport)


def fail_unlisted_skip(report: Report) -> Report:
    """Return the report of a test or module, as a failure if continuous integration does not accept its skip."""
    if os.environ.get("CI") != "true" or not report.skipped or hasattr(report, "wasxfail"):
        return report
    name = report.nodeid.removeprefix("tests/")
    if not any(name == listed or name.startswith((f"{listed}::", f"{listed}[")) for listed in SKIPPED_IN_CI):
        reason = str(report.longrepr[2] if isinstance(report.longrepr, tuple) else report.longrepr)
        remedy = "install what the test needs, or add the skip to SKIPPED_IN_CI in tests/common/suite.py"
        report.outcome = "failed"
        report.longrepr = f"skipped in CI: {reason.removeprefix('Skipped: ')}; {remedy}"
    return report
