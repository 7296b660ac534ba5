"""Which experiment to make next: manoeuvres by what they are predicted to tell, and advice in words."""
