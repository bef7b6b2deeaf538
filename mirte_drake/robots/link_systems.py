"""Messages of a Link as ports, as LcmSubscriberSystem and LcmPublisherSystem do for LCM."""

from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context, EventStatus, LeafSystem, State

from mirte_drake.hardware.link import Link
from mirte_drake.hardware.messages import NOTHING


class LinkSource(LeafSystem):
    """Gives the last message of a kind that has come over a Link; NOTHING before the first.

    .. pydrake_system::

        name: LinkSource
        output_ports:
        - message

    ``message`` is abstract, a state. It is read at initialization and at the beginning of every
    step, so that a message that came before ``AdvanceTo(t)`` is there for the updates at t.
    """

    def __init__(self, link: Link, kind: type) -> None:
        """Declares the port.

        Args:
            link: Where messages come from, while somebody waits on it.
            kind: Of the messages.
        """
        super().__init__()
        self._link, self._kind = link, kind
        self._message = self.DeclareAbstractState(AbstractValue.Make(NOTHING))
        self.DeclareStateOutputPort("message", self._message)
        self.DeclareInitializationUnrestrictedUpdateEvent(self._update)
        self.DeclarePerStepUnrestrictedUpdateEvent(self._update)

    def _update(self, context: Context, next_state: State) -> None:
        message = self._link.latest(self._kind)
        if message is not None:
            next_state.get_mutable_abstract_state(int(self._message)).set_value(message)


class LinkSink(LeafSystem):
    """Sends its input over a Link, whenever the Diagram is told to publish (ForcedPublish).

    .. pydrake_system::

        name: LinkSink
        input_ports:
        - message

    A periodic publish would come before the updates of its instant, with the last command.
    """

    def __init__(self, link: Link) -> None:
        """Declares the port; NOTHING is not sent."""
        super().__init__()
        self._link = link
        self._message = self.DeclareAbstractInputPort("message", AbstractValue.Make(NOTHING))
        self.DeclareForcedPublishEvent(self._publish)

    def _publish(self, context: Context) -> EventStatus:
        message = self._message.Eval(context)
        if message != NOTHING:
            self._link.send(message)
        return EventStatus.Succeeded()
