"""How two vehicle files differ: in words, and in what they predict."""
