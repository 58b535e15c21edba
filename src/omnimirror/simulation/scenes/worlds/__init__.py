"""The scenes that come with omnimirror, and what they are painted and built with."""
