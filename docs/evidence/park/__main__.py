"""python -m docs.evidence.park: see docs/evidence/park/table.py."""

from docs.evidence.park.table import main

if __name__ == "__main__":
    raise SystemExit(main())
