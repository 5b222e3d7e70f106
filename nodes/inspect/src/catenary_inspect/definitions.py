"""Decoding of messages by the definitions in a bag."""

import re

from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore


class Undecodable(Exception):
    """The message cannot be decoded; says why."""


class Definitions:
    """Decoders by definition.

    A definition is the name of a type, the encoding of its messages, the language of its text, and the text. Without a text, the
    types of ROS 2 Jazzy are known.
    """

    def __init__(self):
        self.stores = {}

    def decode(self, definition, data):
        """Decodes one message; raises Undecodable."""
        type_name, encoding, _, _ = definition
        if encoding != "cdr":
            raise Undecodable(f"expected cdr, found {encoding or 'no encoding'}")
        # The parsers of rosbags raise KeyError, struct.error and others on bad bytes.
        try:
            if definition not in self.stores:
                self.stores[definition] = store(definition)
            return self.stores[definition].deserialize_cdr(data, type_name)
        except Undecodable:
            raise
        except Exception as error:
            raise Undecodable(repr(error)) from error


def store(definition):
    """Type store that decodes messages of a definition."""
    type_name, _, language, text = definition
    if not text:
        return get_typestore(Stores.ROS2_JAZZY)
    if language == "ros2msg":
        types = get_types_from_msg(text, type_name)
    elif language in ("ros2idl", "omgidl"):
        types = {}
        for part in re.split(r"^={80}\nIDL: .*\n", text, flags=re.MULTILINE):
            types |= get_types_from_idl(part) if part.strip() else {}
    else:
        raise Undecodable(f"expected a definition in ros2msg, ros2idl or omgidl, found one in {language}")
    made = get_typestore(Stores.EMPTY)
    made.register(types)
    return made
