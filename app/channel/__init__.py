"""How the processes talk: latest values in shared memory, ordered messages over a socket pair."""
