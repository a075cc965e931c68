"""C of the blocks' functions: several stages side by side, and one alone as casadi calls it.

casadi's own C evaluates one stage. Here every operation on a stage's variables applies to `LANES` stages at once, and
what follows from parameters alone is computed once for all of them. The operations and their order are those of
casadi's interpreter, so the numbers are the same to the last bit.

The C is written when the package is built: see setup.py.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import casadi as ca

from planner.backends.casadi_nlp.functions import build_block
from planner.backends.casadi_nlp.symbols import ALL_FORMULAS

MOST_DIFFER = (True, False, True)  # arguments that differ from stage to stage: z and multipliers, not the parameters
EACH_DIFFERS = (True, True, True)  # of the costs
# [-] operations of one C function. A compiler's time grows faster than the length of a function.
PART = 300

OPERATORS = {
    ca.OP_ADD: "{0} + {1}",
    ca.OP_SUB: "{0} - {1}",
    ca.OP_MUL: "{0} * {1}",
    ca.OP_DIV: "{0} / {1}",
    ca.OP_NEG: "-{0}",
    ca.OP_SQ: "{0} * {0}",
    ca.OP_TWICE: "2.0 * {0}",
    ca.OP_INV: "1.0 / {0}",
}
CALLS = {
    ca.OP_EXP: "exp",
    ca.OP_LOG: "log",
    ca.OP_SIN: "sin",
    ca.OP_COS: "cos",
    ca.OP_SQRT: "sqrt",
    ca.OP_FABS: "fabs",
    ca.OP_FMIN: "fmin",
    ca.OP_FMAX: "fmax",
    ca.OP_LT: "less",
}
# What casadi asks of a function from outside: see "Using CasADi's external functions" in its manual.
FOR_CASADI = """
static const long long *const {name}_in[] = {{{taken}}}, *const {name}_out[] = {{{given}}};
long long {name}_n_in(void) {{ return {n_in}; }}
long long {name}_n_out(void) {{ return {n_out}; }}
const long long *{name}_sparsity_in(long long i) {{ return i < {n_in} ? {name}_in[i] : 0; }}
const long long *{name}_sparsity_out(long long i) {{ return i < {n_out} ? {name}_out[i] : 0; }}
int {name}(const double **arg, double **res, long long *iw, double *w, int mem) {{
    static const double none[{most}];
    (void)none;
    lanes {local};
    (void)iw, (void)w, (void)mem;
    {read}
    {name}_lanes({arguments});
    {write}
    return 0;
}}
"""


def write_block(name: str, folder: Path) -> Path:
    """Writes the C of a block's functions, and returns the file.

    Args:
        name: key of `symbols.ALL_FORMULAS`.
        folder: where the file is written.
    """
    block = build_block(name, ALL_FORMULAS[name])
    differs = EACH_DIFFERS if name == "cost" else MOST_DIFFER
    file = folder / f"{name}.c"
    file.write_text(written([(function, differs[: function.n_in()]) for function in block.functions]))
    return file


def written(functions: Iterable[tuple[Any, Sequence[bool]]]) -> str:
    """Returns the C of functions.

    Args:
        functions: casadi functions of scalar operations, and whether each argument differs from stage to stage.

    Raises:
        ValueError: a function has an operation that is not in `OPERATORS` or `CALLS`.
    """
    parts = ['#include "lanes.h"\n']
    for function, differs in functions:
        parts += [_of_lanes(function, differs), _for_casadi(function, differs)]
    return "\n".join(parts)


@dataclass(frozen=True)
class _Value:
    """A value of casadi's work vector.

    Attributes:
        name: in the part of the C that computes it.
        differs: whether it differs from stage to stage.
        part: which computes it; None for constants and arguments, which all parts know by name.
    """

    name: str
    differs: bool
    part: int | None = None


class _Statements:
    """The C of a function's operations, in parts of `PART` statements. What a later part needs is kept in memory.

    casadi gives each result a slot of its work vector, until another result takes it. The same slots are used here, in
    `w` for what differs from stage to stage, and in `s` for what does not.
    """

    def __init__(self, function: Any, differs: Sequence[bool]) -> None:
        self.function = function
        self.differs = differs
        self.parts: list[list[str]] = [[]]
        self._values: dict[int, _Value] = {}
        self._last_uses = self._uses()
        for k in range(function.n_instructions()):
            self._add(k)

    def _uses(self) -> dict[int, int]:
        """Returns how many statements there are before the last one that uses the result of each operation."""
        function = self.function
        results: dict[int, int] = {}
        uses: dict[int, int] = {}
        count = 0
        for k in range(function.n_instructions()):
            operation = function.instruction_id(k)
            if operation not in (ca.OP_CONST, ca.OP_INPUT):
                uses.update((results[slot], count) for slot in function.instruction_input(k))
                count += 1
            if operation != ca.OP_OUTPUT:
                results[function.instruction_output(k)[0]] = k
        return uses

    def _add(self, k: int) -> None:
        operation = self.function.instruction_id(k)
        inputs = self.function.instruction_input(k)
        to, *place = self.function.instruction_output(k)
        if operation == ca.OP_CONST:
            self._values[to] = _Value(f"({float(self.function.instruction_constant(k))!r})", False)
            return
        if operation == ca.OP_INPUT:
            argument, entry = inputs
            self._values[to] = _Value(f"i{argument}[{entry}]", self.differs[argument])
            return
        if len(self.parts[-1]) == PART:
            self.parts.append([])
        operands = [self._operand(slot) for slot in inputs]
        if operation == ca.OP_OUTPUT:
            name, differs = operands[0]
            self.parts[-1].append(f"r{to}[{place[0]}] = {name if differs else f'spread({name})'};")
            return
        expression, differs = self._expression(operation, operands)
        part = len(self.parts) - 1
        line = f"const {'lanes' if differs else 'double'} a{k} = {expression};"
        if self._last_uses.get(k, 0) // PART > part:
            line += f" {self._kept(to, differs)} = a{k};"
        self._values[to] = _Value(f"a{k}", differs, part)
        self.parts[-1].append(line)

    def _operand(self, slot: int) -> tuple[str, bool]:
        value = self._values[slot]
        is_here = value.part is None or value.part == len(self.parts) - 1
        return value.name if is_here else self._kept(slot, value.differs), value.differs

    def _kept(self, slot: int, differs: bool) -> str:
        return f"{'w' if differs else 's'}[{slot}]"

    def _expression(self, operation: int, operands: Sequence[tuple[str, bool]]) -> tuple[str, bool]:
        differs = any(each for _, each in operands)
        if operation in OPERATORS:
            return OPERATORS[operation].format(*(name for name, _ in operands)), differs
        if operation not in CALLS:
            raise ValueError(f"{self.function.name()}: operation {operation} of casadi has no C here")
        spread = [f"spread({name})" if differs and not each else name for name, each in operands]
        return f"{CALLS[operation]}{'_lanes' if differs else ''}({', '.join(spread)})", differs


def _of_lanes(function: Any, differs: Sequence[bool]) -> str:
    name = function.name()
    arguments = [f"i{i}" for i in range(function.n_in())] + [f"r{i}" for i in range(function.n_out())]
    kinds = ["const lanes" if each else "const double" for each in differs] + ["lanes"] * function.n_out()
    taken = ", ".join(f"{kind} *restrict {argument}" for kind, argument in zip(kinds, arguments, strict=True))
    text = ""
    calls = ""
    for i, lines in enumerate(_Statements(function, differs).parts):
        body = "".join(f"    {line}\n" for line in lines)
        text += f"PART void {name}_{i}({taken}, lanes *restrict w, double *restrict s) {{\n{body}}}\n"
        calls += f"    {name}_{i}({', '.join(arguments)}, w, s);\n"
    work = f"    lanes w[{function.sz_w()}];\n    double s[{function.sz_w()}];\n"
    return f"{text}void {name}_lanes({taken}) {{\n{work}{calls}}}\n"


def _for_casadi(function: Any, differs: Sequence[bool]) -> str:
    inputs = range(function.n_in())
    outputs = range(function.n_out())
    name = function.name()
    sizes = [max(function.nnz_in(i), 1) for i in inputs]
    spread = [i for i in inputs if differs[i]]
    results = {i: max(function.nnz_out(i), 1) for i in outputs}
    local = [f"x{i}[{sizes[i]}]" for i in spread] + [f"y{i}[{n}]" for i, n in results.items()]
    read = [f"for (int i = 0; i < {sizes[i]}; i++) x{i}[i] = spread(arg[{i}] ? arg[{i}][i] : 0.0);" for i in spread]
    write = [f"for (int i = 0; res[{i}] && i < {function.nnz_out(i)}; i++) res[{i}][i] = y{i}[i][0];" for i in outputs]
    arguments = [f"x{i}" if i in spread else f"arg[{i}] ? arg[{i}] : none" for i in inputs]
    patterns = [(f"{name}_in_{i}", function.sparsity_in(i)) for i in inputs]
    patterns += [(f"{name}_out_{i}", function.sparsity_out(i)) for i in outputs]
    constants = "".join(f"static const long long {own}[] = {{{_pattern(of)}}};\n" for own, of in patterns)
    return constants + FOR_CASADI.format(
        name=name,
        taken=", ".join(f"{name}_in_{i}" for i in inputs),
        given=", ".join(f"{name}_out_{i}" for i in outputs),
        n_in=len(inputs),
        n_out=len(outputs),
        most=max(sizes),
        local=", ".join(local),
        read="\n    ".join(read),
        arguments=", ".join([*arguments, *(f"y{i}" for i in outputs)]),
        write="\n    ".join(write),
    )


def _pattern(sparsity: Any) -> str:
    """Returns a sparsity as casadi compresses it: rows, columns, first entry of each column, row of each entry."""
    numbers = [sparsity.size1(), sparsity.size2(), *sparsity.colind(), *sparsity.row()]
    return ", ".join(str(int(number)) for number in numbers)
