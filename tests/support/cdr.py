"""Messages of any rosidl type whose fields count up, their bytes in CDR, and comparison of two readers' messages."""

from rosidl_parser.definition import AbstractNestedType, AbstractString, Array, BasicType, BoundedSequence

from .contract import interface


def counted(kind, counter):
    """Next counted value of a rosidl type, as `Filled` of the crate catenary_msgs counts; the empty value if `counter` is None."""
    if isinstance(kind, AbstractNestedType):
        most = kind.maximum_size if isinstance(kind, BoundedSequence) else 2
        count = kind.size if isinstance(kind, Array) else min(2, most) if counter else 0
        return [counted(kind.value_type, counter) for _ in range(count)]
    if isinstance(kind, (BasicType, AbstractString)):
        number = 0
        if counter:
            counter[0] += 1
            number = counter[0]
        if isinstance(kind, AbstractString):
            return f"s{number}" if counter else ""
        if kind.typename == "boolean":
            return number % 2 == 1
        if kind.typename in ("float", "double"):
            return number + 0.5 if counter else 0.0
        return bytes([number % 100]) if kind.typename == "octet" else number % 100
    return counted_message(interface("/".join(kind.namespaced_name())), counter)


def counted_message(cls, counter):
    """Message of a class whose fields continue the count in `counter`, a list with the last number; empty fields if it is None."""
    message = cls()
    for name, kind in zip(cls.get_fields_and_field_types(), cls.SLOT_TYPES):
        setattr(message, name, counted(kind, counter))
    return message


def rosidl_class(type_name):
    """Class of a message, or of a part of a service or action, such as `std_srvs/srv/SetBool_Request`."""
    package, kind, name = type_name.split("/")
    if kind == "msg":
        return interface(type_name)
    base, part = name.rsplit("_", 1)
    return getattr(interface(f"{package}/{kind}/{base}"), part)


SIZES = {"boolean": 1, "octet": 1, "uint8": 1, "int8": 1, "char": 1, "int16": 2, "uint16": 2, "int32": 4, "uint32": 4}
SIZES |= {"float": 4, "int64": 8, "uint64": 8, "double": 8}


def layout(kind, value):
    """Alignment and size of each piece of a value in CDR, in order."""
    if isinstance(kind, AbstractNestedType):
        if not isinstance(kind, Array):
            yield 4, 4
        for element in value:
            yield from layout(kind.value_type, element)
    elif isinstance(kind, BasicType):
        yield SIZES[kind.typename], SIZES[kind.typename]
    elif isinstance(kind, AbstractString):
        yield 4, 4
        yield 1, len(value.encode()) + 1
    else:
        yield from message_layout(value)


def message_layout(message):
    if not message.SLOT_TYPES:
        # An empty structure has a member on the wire that Python hides.
        yield 1, 1
    for name, kind in zip(message.get_fields_and_field_types(), message.SLOT_TYPES):
        yield from layout(kind, getattr(message, name))


def pieces(data, message):
    """Pieces of a CDR message, and the offset after the last one. Padding is left out because Fast CDR leaves it uninitialised."""
    body, offset, found = data[4:], 0, []
    for alignment, size in message_layout(message):
        offset += -offset % alignment
        found.append(body[offset : offset + size])
        offset += size
    return found, offset + 4


def same(message, other):
    """Tells whether a message of rclpy and one of another reader have the same values."""
    if hasattr(message, "get_fields_and_field_types"):
        return all(same(getattr(message, name), getattr(other, name)) for name in message.get_fields_and_field_types())
    if hasattr(message, "__len__") and not isinstance(message, str | bytes):
        return len(message) == len(other) and all(map(same, message, other))
    if isinstance(message, bytes):
        # rclpy has an octet as one byte, other readers as a number.
        other = other if isinstance(other, bytes) else bytes([other])
    return message == other
