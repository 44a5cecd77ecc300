"""OpenFOAM cases: the files of one mesh interval, and the stage that writes those of a run."""
