"""Program that prints the value of GST_PLUGIN_PATH: ``python -m omnimirror.interop.gstreamer``."""

from .frames import PLUGIN_PATH

if __name__ == "__main__":
    print(PLUGIN_PATH)
