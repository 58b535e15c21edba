"""HTTP servers of the studio and the gateway: access control, request limits, start and stop."""
