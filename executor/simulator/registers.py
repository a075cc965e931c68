"""The register file: what clients write (inputs) and what the program and the controller publish (outputs)."""

from __future__ import annotations

from executor.simulator.variables import OUTPUT_TYPES, REGISTERS, WIDTH


class Registers:
    """General purpose registers and the values of every output variable.

    Attributes:
        int_in: input integer registers, kept until overwritten.
        double_in: input double registers, likewise.
        written_at: cycle of the last package that carried each input integer register, -1 before the first.
        outputs: output variable -> list of its numbers.
    """

    def __init__(self) -> None:
        self.int_in = [0] * REGISTERS
        self.double_in = [0.0] * REGISTERS
        self.written_at = [-1] * REGISTERS
        self.outputs: dict[str, list[float]] = {name: [0] * WIDTH[kind] for name, kind in OUTPUT_TYPES.items()}
        self.int_out = [self.outputs[f"output_int_register_{i}"] for i in range(REGISTERS)]
        self.double_out = [self.outputs[f"output_double_register_{i}"] for i in range(REGISTERS)]

    def write_int(self, index: int, value: int) -> None:
        """Sets an output integer register; the value wraps as a signed 32-bit integer does."""
        self.int_out[index][0] = (int(value) + 2**31) % 2**32 - 2**31

    def write_double(self, index: int, value: float) -> None:
        """Sets an output double register."""
        self.double_out[index][0] = float(value)
