"""What servers on a machine have in common: who may talk to them, how much they take, how they begin and end."""
