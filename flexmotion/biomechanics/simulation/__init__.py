"""Forward simulation of the human: a motion is tracked under perturbations that the recording did not have."""
