"""The nodes of the cart-pole."""
