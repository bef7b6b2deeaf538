"""The thesis's figures again, from its recordings and from our runs."""
