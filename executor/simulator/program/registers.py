"""General purpose registers between a client and the program."""

from __future__ import annotations

from executor.simulator.settings import REGISTERS


class Registers:
    """Input registers written by clients, output registers written by the program.

    Attributes:
        int_in: input integer registers; a value stays until it is overwritten.
        double_in: input double registers, kept in the same way.
        written_at: cycle of the last data package that carried each input integer register, -1 before the first.
        int_out: output integer registers, each a list of one number.
        double_out: output double registers, each a list of one number.
    """

    def __init__(self) -> None:
        self.int_in = [0] * REGISTERS
        self.double_in = [0.0] * REGISTERS
        self.written_at = [-1] * REGISTERS
        self.int_out: list[list[float]] = [[0] for _ in range(REGISTERS)]
        self.double_out = [[0.0] for _ in range(REGISTERS)]

    def write_int(self, index: int, value: int) -> None:
        """Sets an output integer register; the value wraps as a signed 32-bit integer."""
        self.int_out[index][0] = (int(value) + 2**31) % 2**32 - 2**31

    def write_double(self, index: int, value: float) -> None:
        """Sets an output double register."""
        self.double_out[index][0] = float(value)


class OffsetRegisters:
    """The registers as one client's program sees them: its indices begin at an offset."""

    def __init__(self, registers: Registers, offset_int: int, offset_double: int) -> None:
        self.registers = registers
        self.offset_int, self.offset_double = offset_int, offset_double

    def int_in(self, index: int) -> int:
        """Returns an input integer register."""
        return self.registers.int_in[index + self.offset_int]

    def double_in(self, index: int) -> float:
        """Returns an input double register."""
        return self.registers.double_in[index + self.offset_double]

    def doubles_in(self, index: int, count: int = 6) -> list[float]:
        """Returns `count` input double registers from `index` on."""
        first = index + self.offset_double
        return self.registers.double_in[first : first + count]

    def int_out(self, index: int, value: int) -> None:
        """Writes an output integer register."""
        self.registers.write_int(index + self.offset_int, value)

    def doubles_out(self, values: list[float]) -> None:
        """Writes output double registers from index 0 on."""
        for i, value in enumerate(values):
            self.registers.write_double(i + self.offset_double, value)
