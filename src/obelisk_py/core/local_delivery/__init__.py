"""Messages from publisher to subscription within one process, past DDS.

`exchange` knows the subscriptions that the library's executor runs, by context and topic; each has
an `inbox`. A `publisher` hands its messages to the inboxes of those that `matching` says DDS would
match, as long as DDS counts nobody else: then nothing is sent. As soon as somebody else listens,
all get the messages by DDS.

What holds for a publisher and a subscription, whoever else comes and goes:

- No message comes twice: each goes to the inboxes or to DDS, never to both.
- None is lost that DDS would not lose. A listener from outside gets what is published after the
  publisher has found it, as with DDS alone. An inbox keeps as many messages as the subscription's
  history and then drops the oldest; where some wait in DDS too, both keep that many.
- Their order is that of publishing as long as DDS delivers within `publish`, as Fast DDS does in
  one process: a publisher that has sent by DDS goes on so until the subscription has taken all that
  DDS held for it. With `RMW_FASTRTPS_PUBLICATION_MODE=ASYNCHRONOUS`, messages around the moment at
  which an outside listener comes or goes may change places. Between publishers there is no order.
- Messages that wait when a subscription is destroyed are gone, as with DDS. Those that wait when
  its node is taken off an `EventLoopExecutor` come once such an executor runs it again; another
  executor does not see them.
"""
