"""The two solvers of an assembled problem: fatrop, which knows the stages, and IPOPT, which does not and fails less."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca

from planner.backends.casadi_nlp.layout import NU, NX
from planner.backends.casadi_nlp.table import Table

# Everything is differentiated by the blocks; casadi must not try.
QUIET = {"print_time": False, "error_on_fail": False, "calc_lam_p": False, "calc_lam_x": False}
NLP_GRAD = ("all", ["f", "g", "grad:gamma:x", "grad:gamma:p"])


def fatrop(functions: Mapping[str, Any], table: Table, options: Mapping[str, Any]) -> Any:
    """Returns the fatrop solver of the problem."""
    stages = table.shape.stages
    return ca.nlpsol(
        "launch",
        "fatrop",
        _problem(functions),
        {
            **QUIET,
            "cache": _named(
                functions,
                {
                    "nlp_f": ("f", ["f"]),
                    "nlp_g": ("g", ["g"]),
                    "nlp_grad_f": ("grad_f", ["grad:f:x"]),
                    "nlp_jac_g": ("jac_g", ["g", "jac:g:x"]),
                    "nlp_hess_l": ("hess_l", ["grad:gamma:x", "hess:gamma:x:x"]),
                    "nlp_grad": NLP_GRAD,
                },
            ),
            "structure_detection": "manual",
            "N": stages,
            "nx": [NX] * (stages + 1),
            "nu": [NU] * stages + [0],
            "ng": table.ng,
            "fatrop": {"print_level": 0, **options},
        },
    )


def ipopt(functions: Mapping[str, Any], options: Mapping[str, Any]) -> Any:
    """Returns the IPOPT solver of the same problem."""
    x, p, lam_f, lam_g = (functions["hess_l"].mx_in(i) for i in range(4))
    upper = ca.triu(functions["hess_l"](x, p, lam_f, lam_g)[1])
    both = [functions["f"](x, p), functions["grad_f"](x, p)]
    more = {
        "upper": ca.Function("upper", [x, p, lam_f, lam_g], [upper]),
        "value_and_grad_f": ca.Function("value_and_grad_f", [x, p], both),
    }
    return ca.nlpsol(
        "launch",
        "ipopt",
        _problem(functions),
        {
            **QUIET,
            "cache": _named(
                {**functions, **more},
                {
                    "nlp_f": ("f", ["f"]),
                    "nlp_g": ("g", ["g"]),
                    "nlp_grad_f": ("value_and_grad_f", ["f", "grad:f:x"]),
                    "nlp_jac_g": ("jac_g", ["g", "jac:g:x"]),
                    "nlp_hess_l": ("upper", ["triu:hess:gamma:x:x"]),
                    "nlp_grad": NLP_GRAD,
                },
            ),
            "ipopt": {"print_level": 0, "sb": "yes", **options},
        },
    )


def _problem(functions: Mapping[str, Any]) -> dict[str, Any]:
    x, p = functions["g"].mx_in(0), functions["g"].mx_in(1)
    return {"x": x, "p": p, "f": functions["f"](x, p), "g": functions["g"](x, p)}


def _named(functions: Mapping[str, Any], roles: Mapping[str, tuple[str, list[str]]]) -> dict[str, Any]:
    """Returns the functions under the names that casadi would give to those it makes itself."""
    functions = {**functions, "all": _summary(functions)}
    named = {}
    for role, (name, outputs) in roles.items():
        function = functions[name]
        inputs = [function.mx_in(i) for i in range(function.n_in())]
        results = function(*inputs)
        results = list(results) if isinstance(results, (list, tuple)) else [results]
        scheme = ["x", "p", "lam:f", "lam:g"][: len(inputs)]
        named[role] = ca.Function(role, inputs, results, [_safe(i) for i in scheme], [_safe(o) for o in outputs])
    return named


def _summary(functions: Mapping[str, Any]) -> Any:
    """Returns what casadi evaluates at the solution: values, and the Lagrangian's gradient, unused by p."""
    x, p, lam_f, lam_g = (functions["hess_l"].mx_in(i) for i in range(4))
    slope = functions["hess_l"](x, p, lam_f, lam_g)[0]
    return ca.Function(
        "all", [x, p, lam_f, lam_g], [functions["f"](x, p), functions["g"](x, p), slope, ca.MX.zeros(p.shape)]
    )


def _safe(name: str) -> str:
    return name.replace(":", "_")
