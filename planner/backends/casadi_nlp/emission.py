"""C of the blocks' functions: several stages side by side, and one alone as casadi calls it.

casadi's own C evaluates one stage. Here every operation on a stage's variables applies to `LANES` stages at once, and
what follows from parameters alone is computed once for all of them. The operations and their order are those of
casadi's interpreter, so the numbers are the same to the last bit.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import casadi as ca

HEADER = Path(__file__).parent / "c" / "lanes.h"

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
    lanes {local};
    (void)iw, (void)w, (void)mem;
    {read}
    {name}_lanes({arguments});
    {write}
    LEAVE_LANES();
    return 0;
}}
"""


def written(functions: Iterable[tuple[Any, Sequence[bool]]]) -> str:
    """Returns the C of functions.

    Args:
        functions: casadi functions of scalar operations, and whether each argument differs from stage to stage.

    Raises:
        ValueError: a function has an operation that is not in `OPERATORS` or `CALLS`.
    """
    parts = [HEADER.read_text()]
    for function, differs in functions:
        parts += [_of_lanes(function, differs), _for_casadi(function, differs)]
    return "\n".join(parts)


class _Values:
    """The C names of a function's work vector, and whether each differs from stage to stage."""

    def __init__(self, function: Any, differs: Sequence[bool]) -> None:
        self.function = function
        self.differs = differs
        self.names: dict[int, tuple[str, bool]] = {}

    def lines(self) -> Iterator[str]:
        """Yields the statements."""
        for k in range(self.function.n_instructions()):
            inputs = self.function.instruction_input(k)
            outputs = self.function.instruction_output(k)
            line = self._line(k, self.function.instruction_id(k), inputs, outputs)
            if line:
                yield f"    {line}"

    def _line(self, k: int, operation: int, inputs: Sequence[int], outputs: Sequence[int]) -> str:
        if operation == ca.OP_CONST:
            self.names[outputs[0]] = f"({float(self.function.instruction_constant(k))!r})", False
            return ""
        if operation == ca.OP_INPUT:
            argument, entry = inputs
            return self._declared(k, outputs[0], f"i{argument}[{entry}]", self.differs[argument])
        names = [self.names[i] for i in inputs]
        if operation == ca.OP_OUTPUT:
            name, differs = names[0]
            return f"r{outputs[0]}[{outputs[1]}] = {name if differs else f'spread({name})'};"
        return self._declared(k, outputs[0], *self._expression(operation, names))

    def _declared(self, k: int, slot: int, expression: str, differs: bool) -> str:
        self.names[slot] = f"a{k}", differs
        return f"const {'lanes' if differs else 'double'} a{k} = {expression};"

    def _expression(self, operation: int, names: Sequence[tuple[str, bool]]) -> tuple[str, bool]:
        differs = any(each for _, each in names)
        if operation in OPERATORS:
            return OPERATORS[operation].format(*(name for name, _ in names)), differs
        if operation not in CALLS:
            raise ValueError(f"{self.function.name()}: operation {operation} of casadi has no C here")
        spread = [f"spread({name})" if differs and not each else name for name, each in names]
        return f"{CALLS[operation]}{'_lanes' if differs else ''}({', '.join(spread)})", differs


def _of_lanes(function: Any, differs: Sequence[bool]) -> str:
    taken = [f"const {'lanes' if each else 'double'} *i{i}" for i, each in enumerate(differs)]
    given = [f"lanes *r{i}" for i in range(function.n_out())]
    lines = "\n".join(_Values(function, differs).lines())
    return f"void {function.name()}_lanes({', '.join(taken + given)}) {{\n{lines}\n}}\n"


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
