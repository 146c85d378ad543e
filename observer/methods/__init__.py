"""How moving obstacles are found: one module for each method, and the contract they fulfil."""
