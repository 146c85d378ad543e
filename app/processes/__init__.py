"""What the server's processes have in common."""
