"""The errors a user can cause, each a ``ValueError`` that names the value and what would be valid."""


class OmnimirrorError(ValueError):
    """Base of every error the package raises on purpose; the command line prints it as one sentence."""


class InvalidParameter(OmnimirrorError):
    """A parameter is outside its range, or parameters do not fit each other."""


class OutsideMirror(OmnimirrorError):
    """A point was asked for where the mirror has no surface."""


class OutsideField(OmnimirrorError):
    """A field angle, pixel or mirror position lies outside what the sensor sees."""


class NotOneToOne(OmnimirrorError):
    """The field angle does not grow steadily with the mirror radius, so it has no inverse."""


class SelfObstruction(OmnimirrorError):
    """The mirror hides part of itself from the lens or from the scene."""


class SpecError(OmnimirrorError):
    """A sensor file or requirements are wrong; the message says where and what would be valid."""


class MediaError(OmnimirrorError):
    """A picture cannot be read or written."""


class NotReproduced(OmnimirrorError):
    """A number of the paper does not get the verdict that is known to be right; the message names the row."""
