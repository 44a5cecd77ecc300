"""Mutation run: of small faults in the modules that make numbers, how many do their tests find?

python -m docs.evidence.mutants [MODULE ...] [--sample 15]

A mutant differs by one operator, number or function; the random sample is always the same. Module
and tests are imported once, and a fork runs the tests of each mutant: mutmut and cosmic-ray import
anew and do not reach compiled code. `<` becomes `>`; `<=` would mostly mean the same for floats.
"""

import argparse
import ast
import copy
import os
import random
import resource
import sys
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from types import CodeType
from typing import Any

import pytest
from _pytest.runner import runtestprotocol
from numba.core.caching import NullCache
from numba.core.dispatcher import Dispatcher

TESTS = {  # of each module, below tests/
    "piv.correlation.newton_step": "analytic/piv/test_window_equations.py",
    "piv.correlation.passes": "analytic/piv/test_passes.py",
    "piv.correlation.uncertainty": "analytic/piv/test_window_equations.py",
    "piv.vortices.regions": "analytic/piv/test_tip_vortex.py",
    "piv.vortices.joint_fit": "analytic/piv/test_joint_fit.py",
    "piv.momentum.pressure": "analytic/piv/test_pressure.py",
    "pipeline.mesh.morph": "analytic/mesh/test_morph.py",
    "pipeline.geometry.quality": "analytic/mesh/test_morph.py",
    "pipeline.structure.chain": "analytic/structure/test_chain.py",
    "pipeline.structure.coupling": "analytic/structure/test_coupling.py",
    "pipeline.solve.guards": "unit/solve/test_guards.py",
    "pipeline.solve.power": "analytic/mesh/test_dissipation.py unit/solve/test_guards.py",
    "postprocess.evidence.strokes": "unit/postprocess/test_strokes.py",
    "postprocess.compare.quantities": "analytic/postprocess/test_quantities.py",
    "postprocess.lab.register": "unit/lab/test_lab_budget.py",
    "softfinger.study.errors": (
        "unit/study/test_tradeoff.py analytic/postprocess/test_compare_fields.py"
    ),
}
_PAIRS = (
    "Lt Gt, LtE GtE, Eq NotEq, Is IsNot, Add Sub, Mult Div, BitAnd BitOr, And Or, USub UAdd,"
    " min max, minimum maximum, argmin argmax, any all, sin cos, mean median, nanmin nanmax,"
    " sqrt abs, real imag"
)
_SWAPS = {a: b for pair in _PAIRS.split(", ") for a, b in (pair.split(), pair.split()[::-1])}
_WORDS = (ast.Raise, ast.JoinedStr, ast.arguments)
_FIELDS = ("annotation", "returns", "decorator_list", "ops", "op", "ctx")
Mutant = tuple[ast.stmt, str, Any]  # top statement, name of its function ("": a constant), node


def mutate(node: Any) -> bool:
    """Change a node in place; False where it has no mutant."""
    if isinstance(node, ast.Compare) and (name := type(node.ops[0]).__name__) in _SWAPS:
        node.ops[0] = getattr(ast, _SWAPS[name])()
    elif (name := type(getattr(node, "op", None)).__name__) in _SWAPS:
        node.op = getattr(ast, _SWAPS[name])()
    elif isinstance(node, ast.Constant) and type(node.value) in (bool, int, float):
        old: Any = node.value
        more = old + 1 if isinstance(old, int) else 2 * old or 1.0
        node.value = not old if isinstance(old, bool) else more
    elif getattr(node, "attr", "") in _SWAPS:
        node.attr = _SWAPS[node.attr]
    elif getattr(node, "id", "") in _SWAPS:
        node.id = _SWAPS[node.id]
    else:
        return False
    return True


def below(node: ast.AST) -> Iterator[ast.AST]:
    """All nodes below one that are no words, types or defaults."""
    for name, value in ast.iter_fields(node):
        for child in value if isinstance(value, list) else [value]:
            if isinstance(child, ast.AST) and not isinstance(child, _WORDS) and name not in _FIELDS:
                yield child
                yield from below(child)


def mutants(tree: ast.Module) -> list[Mutant]:
    """All mutants of a module."""
    parts = [(top, getattr(top, "name", ""), top) for top in tree.body]
    parts = [p for p in parts if isinstance(p[0], ast.FunctionDef | ast.Assign)] + [
        (top, f"{name}.{f.name}", f)
        for top, name, _ in parts if isinstance(top, ast.ClassDef)
        for f in top.body if isinstance(f, ast.FunctionDef)
    ]  # fmt: skip
    found = [(top, name, node) for top, name, part in parts for node in below(part)]
    return [each for each in found if mutate(copy.deepcopy(each[2]))]


class Campaign:
    """A plugin of pytest that runs the collected tests for each mutant of a module."""

    def __init__(self, name: str, sample: int) -> None:
        self.module, self.sample = import_module(name), sample
        self.file = str(self.module.__file__)
        self.tree = ast.parse(Path(self.file).read_text("utf-8"))

    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        """Print how many mutants no test finds, and which."""
        begin = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
        if self.fails(session.items, None, 600):
            raise SystemExit(f"{self.module.__name__}: its tests fail without a mutant")
        limit = 10 + 3 * int(resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - begin)
        found = mutants(self.tree)
        tried = random.Random(51).sample(found, min(self.sample, len(found)))
        alive = 0
        for each in tried:
            if not self.fails(session.items, each, limit):
                alive, node = alive + 1, each[2]
                mutate(new := copy.deepcopy(node))
                print(f"    {node.lineno}: {ast.unparse(node)} → {ast.unparse(new)}", flush=True)
        print(f"{self.module.__name__}, {len(found)}, {len(tried)}, {len(tried) - alive}")
        return True

    def fails(self, items: list[pytest.Item], mutant: Mutant | None, limit: int) -> bool:
        """Whether a test fails, or all take longer than `limit` (s of CPU), in a fork."""
        pid = os.fork()
        if pid:
            return os.waitpid(pid, 0)[1] != 0
        try:
            resource.setrlimit(resource.RLIMIT_CPU, (limit, limit))
            os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
            if mutant:
                self.install(*mutant)
            for item, after in zip(items, [*items[1:], None], strict=True):
                if any(r.failed for r in runtestprotocol(item, nextitem=after, log=False)):
                    os._exit(1)
            os._exit(0)
        finally:
            os._exit(2)

    def install(self, top: ast.stmt, name: str, node: ast.AST) -> None:
        """Put the changed function or constant into the module, and wherever it was imported."""
        mutate(node)
        target: Any = self.module
        old = dict(vars(target))
        codes = [compile(self.tree, self.file, "exec")]
        for code in codes:
            codes += [const for const in code.co_consts if isinstance(const, CodeType)]
        for part in name.split(".") if name else ():
            target = vars(target)[part]
        for wrapper in ("fget", "func", "__func__", "__wrapped__", "py_func") if name else ():
            target = getattr(target, wrapper, target)
        if name:
            target.__code__ = next(code for code in codes if code.co_qualname == name)
        else:
            exec(compile(ast.Module([top], []), self.file, "exec"), vars(self.module))
        new = {key: vars(self.module)[key] for key in old if vars(self.module)[key] is not old[key]}
        mine = {id(each) for each in old.values() if isinstance(each, Dispatcher)}
        for other in list(sys.modules.values()):
            for key, value in new.items():
                if vars(other).get(key) is old[key]:
                    setattr(other, key, value)
            compiled: list[Any] = [v for v in vars(other).values() if isinstance(v, Dispatcher)]
            if mine & {id(each) for each in compiled}:  # Numba's files hold the old constants
                for each in compiled:
                    each._cache = NullCache()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m docs.evidence.mutants")
    parser.add_argument("modules", nargs="*", default=[*TESTS])
    parser.add_argument("--sample", type=int, default=15, help="mutants of each (15)")
    args = parser.parse_args()
    print("module, mutants, tried, found by its tests")
    for name in args.modules:
        tests = [f"tests/{path}" for path in TESTS[name].split()]
        words = ["-q", "-p", "no:cacheprovider", "-m", "not openfoam and not slow"]
        pytest.main([*words, *tests], plugins=[Campaign(name, args.sample)])
