"""Write places and displacements of the nodes of an Abaqus .odb as CSV (docs/fea.md).

Runs in Abaqus' own Python (2.7 or 3), where the model's results are:

    abaqus python abaqus_export.py job.odb STEP MAX_PRESSURE_KPA nodes.csv [NODE_SET]

STEP is the step that ramps the pressure to MAX_PRESSURE_KPA (negative for suction): the frame's time
over the step's length is taken as the share of it, as *DLOAD or *DSLOAD without an amplitude ramps.
NODE_SET is a node set of the assembly, the ventral profile from root to tip. Lengths stay in the
model's unit. Leave out frames after the last converged one.
"""

# ruff: noqa -- Abaqus up to 2023 runs Python 2.7
from __future__ import print_function

import csv
import sys

from abaqusConstants import DOUBLE_PRECISION
from odbAccess import openOdb

COLUMNS = ["pressure_kpa", "instance", "node", "x", "y", "z", "u1", "u2", "u3", "profile"]


def rows(assembly, frame, chosen):
    """Instance, node, place, displacement and mark of every node of a frame."""
    places = {}
    for name in assembly.instances.keys():
        for node in assembly.instances[name].nodes:
            places[name, node.label] = list(node.coordinates)
    for value in frame.fieldOutputs["U"].values:
        if value.instance is not None:  # else a reference point
            u = value.dataDouble if value.precision == DOUBLE_PRECISION else value.data
            key = (value.instance.name, value.nodeLabel)
            moved = list(u) + [0.0] * (3 - len(u))
            yield list(key) + ["%.9g" % v for v in places[key] + moved] + [int(key in chosen)]


def main(path, step_name, top_kpa, target, set_name=None):
    odb = openOdb(path, readOnly=True)
    try:
        if step_name not in odb.steps.keys():
            sys.exit("%s: no step %r: it has %s" % (path, step_name, ", ".join(odb.steps.keys())))
        step, sets = odb.steps[step_name], odb.rootAssembly.nodeSets
        if set_name and set_name not in sets.keys():
            sys.exit("%s: no node set %r: it has %s" % (path, set_name, ", ".join(sets.keys())))
        parts = sets[set_name].nodes if set_name else []
        chosen = set((node.instanceName, node.label) for part in parts for node in part)
        out = open(target, "w")
        try:
            writer = csv.writer(out, lineterminator="\n")
            writer.writerow(COLUMNS)
            for frame in step.frames:
                pressure = top_kpa * frame.frameValue / step.timePeriod
                for row in rows(odb.rootAssembly, frame, chosen):
                    writer.writerow(["%.9g" % pressure] + row)
                print("%s: frame at %.4g kPa" % (target, pressure))
        finally:
            out.close()
    finally:
        odb.close()


if __name__ == "__main__":
    if len(sys.argv) not in (5, 6):
        sys.exit(__doc__)
    main(sys.argv[1], sys.argv[2], float(sys.argv[3]), *sys.argv[4:])
