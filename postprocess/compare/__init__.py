"""Stage compare: CFD and PIV, judged by a scene's findings."""
