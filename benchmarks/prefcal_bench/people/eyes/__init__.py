"""People with eyes: what differs by less than they notice is about the same to them."""
