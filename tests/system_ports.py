"""What the tests of the systems ask about ports."""

from pydrake.systems.framework import PortDataType, System


def port_table(system: System) -> tuple[dict, dict]:
    inputs, outputs = _ports(system)
    return {p.get_name(): _size(p) for p in inputs}, {p.get_name(): _size(p) for p in outputs}


def feedthrough(system: System) -> set[tuple[str, str]]:
    inputs, outputs = _ports(system)
    return {
        (i.get_name(), o.get_name())
        for i in inputs
        for o in outputs
        if system.HasDirectFeedthrough(i.get_index(), o.get_index())
    }


def _ports(system: System) -> tuple[list, list]:
    inputs = [system.get_input_port(i) for i in range(system.num_input_ports())]
    outputs = [system.get_output_port(i) for i in range(system.num_output_ports())]
    return inputs, outputs


def _size(port) -> int | str:
    abstract = port.get_data_type() == PortDataType.kAbstractValued
    return "abstract" if abstract else port.size()
