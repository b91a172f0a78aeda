"""Which test files take longest; `conftest.py` has them begin first.

In a new checkout the first compiles loops (numba), which takes a minute and is kept on the disk: those of the other
process that come next need none, so that it does not compile them at the same time.
"""

# Files of more than some eight seconds (OMP_NUM_THREADS=1 pytest -n 0 FILE --durations=0).
LONGEST = (
    "test_experiment_commands.py",
    "test_kills.py",
    "test_judging.py",
    "test_terminal.py",
    "test_imports.py",
    "test_hand_command.py",
    "test_hostile_readers.py",
    "test_hostile_tables.py",
    "test_shipped_hands.py",
    "test_wrong_hands.py",
    "test_scene_cases.py",
    "test_serve_command.py",
    "test_judged_commands.py",
    "test_launchers.py",
    "test_folders.py",
    "test_clutter_command.py",
    "test_docs.py",
    "test_report_command.py",
    "test_tutorials.py",
    "test_spgf.py",
    "test_viewing.py",
    "test_robot.py",
    "test_urdf_pieces.py",
    "test_recorded_training.py",
    "test_execute.py",
    "test_shell.py",
    "test_panda.py",
    "test_episode.py",
    "test_baseline_command.py",
    "test_ops.py",
    "test_proposals.py",
    "test_own_trials.py",
    "test_forks.py",
    "test_attempts.py",
    "test_generation.py",
    "test_clutter_page.py",
    "test_grasp_viewer.py",
    "test_dask.py",
)
