"""Parameter studies and designs of experiments for the thrust force of tripod constant velocity joints."""
