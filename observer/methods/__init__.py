"""Methods that find moving obstacles: one package each, and the contract they fulfil."""
