"""From kinematics to the laser sheet: scene, kinematics, motion, mesh, case, run, sheet."""
