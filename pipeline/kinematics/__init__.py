"""Stage kinematics: the pressure law and the finger's shapes."""
