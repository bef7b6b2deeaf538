import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from scripted_link import ScriptedLink
from system_ports import port_table

from mirte_drake.hardware.messages import NOTHING, Odometry
from mirte_drake.robots.link_systems import LinkSink, LinkSource

MESSAGE = Odometry(5, np.arange(3.0), np.zeros(3))


def test_ports():
    link = ScriptedLink()
    assert port_table(LinkSource(link, Odometry)) == ({}, {"message": "abstract"})
    assert port_table(LinkSink(link)) == ({"message": "abstract"}, {})


def test_a_message_is_there_for_the_updates_of_the_next_instant():
    link = ScriptedLink()
    source = LinkSource(link, Odometry)
    simulator = Simulator(source)
    simulator.AdvanceTo(0.1)
    assert source.get_output_port().Eval(simulator.get_context()) == NOTHING
    link.at(100.0, MESSAGE)
    link.wait(0.0)
    assert source.get_output_port().Eval(simulator.get_context()) == NOTHING  # A state.
    simulator.AdvanceTo(0.2)
    assert source.get_output_port().Eval(simulator.get_context()).stamp == 5


def test_nothing_is_sent_but_when_told():
    link = ScriptedLink()
    builder = DiagramBuilder()
    sink = builder.AddSystem(LinkSink(link))
    builder.ExportInput(sink.get_input_port(), "message")
    diagram = builder.Build()
    simulator = Simulator(diagram)
    context = simulator.get_mutable_context()
    diagram.GetInputPort("message").FixValue(context, NOTHING)
    simulator.AdvanceTo(0.3)
    diagram.ForcedPublish(context)
    assert link.sent == []
    diagram.GetInputPort("message").FixValue(context, MESSAGE)
    simulator.AdvanceTo(0.6)
    assert link.sent == []
    diagram.ForcedPublish(context)
    assert [message.stamp for _, message in link.sent] == [5]
