"""Run experiments: train several policies, evaluate them on seen and unseen objects, and write one report."""

from gensim2.policy.experiments.config import NAMES, Arm, ExperimentConfig, Name, config_of, read_experiment
from gensim2.policy.experiments.running import run_experiment

__all__ = ["NAMES", "Arm", "ExperimentConfig", "Name", "config_of", "read_experiment", "run_experiment"]
