"""The nouns that measurement and simulation share; imports nothing else of rigtwin."""
