"""What a network is made of: bodies, contacts, couplings and excitations, and their composition."""
