"""What happened, kept: the recorder, its files, and everything that reads them. Nothing here can reach a motor."""
