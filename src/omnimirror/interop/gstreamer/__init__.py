"""Element ``omnimirrordewarp`` of GStreamer; the plug-in file is in the folder ``python``."""
