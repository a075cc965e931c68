import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from simulator.interfaces import wire
from simulator.interfaces.recipes import InputOwners, input_recipe, output_recipe, output_types
from simulator.interfaces.variables import IN_USE, NOT_FOUND

E_SERIES = (5, 11, 1)


def test_a_package_is_size_type_body():
    assert wire.package(wire.REQUEST_PROTOCOL_VERSION, b"\x00\x02") == b"\x00\x05V\x00\x02"


@given(st.lists(st.tuples(st.integers(0, 255), st.binary(max_size=50)), max_size=6), st.data())
def test_packages_come_out_as_they_went_in_however_they_are_cut(packages, data):
    stream = b"".join(wire.package(kind, body) for kind, body in packages)
    buffer = bytearray()
    found = []
    at = 0
    while at < len(stream):
        size = data.draw(st.integers(1, len(stream) - at))
        buffer += stream[at : at + size]
        at += size
        found += list(wire.take_packages(buffer))
    assert found == packages
    assert not buffer


def test_a_size_below_the_header_is_malformed():
    with pytest.raises(wire.MalformedPackage):
        list(wire.take_packages(bytearray(b"\x00\x02V")))


def test_output_package_has_the_layout_of_the_rtde_guide():
    recipe = output_recipe(["timestamp", "actual_q", "runtime_state", "actual_digital_output_bits"], every=1)
    values = {
        "timestamp": [1.5],
        "actual_q": [0.0, 1.0, 2.0, 3.0, 4.0, 5.0],
        "runtime_state": [2],
        "actual_digital_output_bits": [1 << 40],
    }
    data = recipe.encode(values)
    assert data == struct.pack(">HBB d 6d I Q", 72, 85, 1, 1.5, 0, 1, 2, 3, 4, 5, 2, 1 << 40)


def test_an_output_package_of_one_variable():
    assert output_recipe(["timestamp"], 1).encode({"timestamp": [2.0]}) == struct.pack(">HBB d", 12, 85, 1, 2.0)


def test_speedj_recipe_of_ur_rtde_has_72_bytes():
    recipe = input_recipe(["input_int_register_0", *(f"input_double_register_{i}" for i in range(8))])
    assert recipe.layout.size + 4 == 72
    body = struct.pack(">i8d", 9, *range(8))
    decoded = recipe.decode(body)
    assert decoded.ints == [(0, 9)]
    assert decoded.doubles == [(0, tuple(range(8)))]
    assert not decoded.others
    with pytest.raises(wire.MalformedPackage):
        recipe.decode(body[:-1])


def test_runs_of_registers_may_start_anywhere_and_break_off():
    recipe = input_recipe([f"input_double_register_{i}" for i in (3, 4, 7, 6, 7)])
    assert recipe.decode(struct.pack(">5d", *range(5))).doubles == [(3, (0, 1)), (7, (2,)), (6, (3, 4))]


def test_a_vector_input_is_cut_out_whole():
    recipe = input_recipe(["input_int_register_0", "external_force_torque"])
    assert recipe.decode(struct.pack(">i6d", 1, *range(6))).others["external_force_torque"] == (0, 1, 2, 3, 4, 5)


def test_types_by_version():
    assert output_types(["payload_inertia", "nonsense"], E_SERIES) == ["VECTOR6D", NOT_FOUND]
    assert output_types(["payload_inertia"], (5, 10, 0)) == [NOT_FOUND]
    assert output_types(["ft_raw_wrench"], (3, 15, 0)) == [NOT_FOUND]


def test_an_input_belongs_to_one_connection_until_it_ends():
    owners = InputOwners()
    owners.claim(["input_int_register_0"], "first")
    assert owners.types(["input_int_register_0"], "first", E_SERIES) == ["INT32"]
    assert owners.types(["input_int_register_0", "nonsense"], "second", E_SERIES) == [IN_USE, NOT_FOUND]
    owners.release("first")
    assert owners.types(["input_int_register_0"], "second", E_SERIES) == ["INT32"]
