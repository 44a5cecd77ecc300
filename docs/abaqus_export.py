"""Write nodal displacements and the pressure of every frame of an Abaqus .odb as CSV (docs/fea.md).

Runs in Abaqus' own Python (2.7 or 3), where the model's results are:

    abaqus python abaqus_export.py job.odb STEP MAX_PRESSURE_KPA displacements.csv

STEP is the step in which the pressure is ramped to MAX_PRESSURE_KPA (negative for suction): the frame's time over the
step's length is taken as the share of it, as *DLOAD or *DSLOAD without an amplitude ramps. Frames are written as they
are: leave out those after the last converged one. Lengths stay in the model's unit.
"""

# ruff: noqa -- Abaqus up to 2023 runs Python 2.7
from __future__ import print_function

import csv
import sys

from abaqusConstants import DOUBLE_PRECISION
from odbAccess import openOdb


def displacements(frame):
    """(instance, node, u1, u2, u3) of every node of a frame."""
    for value in frame.fieldOutputs["U"].values:
        u = value.dataDouble if value.precision == DOUBLE_PRECISION else value.data
        name = value.instance.name if value.instance is not None else ""
        yield name, value.nodeLabel, u[0], u[1], u[2] if len(u) > 2 else 0.0


def main(path, step_name, top_kpa, target):
    odb = openOdb(path, readOnly=True)
    try:
        if step_name not in odb.steps.keys():
            sys.exit("%s: no step %r: it has %s" % (path, step_name, ", ".join(odb.steps.keys())))
        step = odb.steps[step_name]
        out = open(target, "w")
        try:
            writer = csv.writer(out, lineterminator="\n")
            writer.writerow(["pressure_kpa", "instance", "node", "u1", "u2", "u3"])
            for frame in step.frames:
                pressure = top_kpa * frame.frameValue / step.timePeriod
                for name, label, u1, u2, u3 in displacements(frame):
                    writer.writerow(
                        ["%.9g" % pressure, name, label, "%.9g" % u1, "%.9g" % u2, "%.9g" % u3]
                    )
                print("%s: frame at %.4g kPa" % (target, pressure))
        finally:
            out.close()
    finally:
        odb.close()


if __name__ == "__main__":
    if len(sys.argv) != 5:
        sys.exit(__doc__)
    main(sys.argv[1], sys.argv[2], float(sys.argv[3]), sys.argv[4])
