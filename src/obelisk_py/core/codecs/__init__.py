"""Messages to the bytes that go over the wire, and back.

`codec_for` gives the codec of a message class; a codec packs, unpacks and copies.
"""

from obelisk_py.core.codecs.codec import Codec, codec_for

__all__ = ["Codec", "codec_for"]
