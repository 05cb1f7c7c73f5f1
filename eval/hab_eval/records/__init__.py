"""Records of runs: files, submissions and tables; nothing here plays episodes."""
