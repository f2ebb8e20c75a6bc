"""Episodes: plan, run, judge and record, one loop whoever decides what the robot does."""
