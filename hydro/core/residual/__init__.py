"""What a hull does that no formula of its file says: learnt from one recording, held fixed in another."""
