"""What is done with a recorded run: replay it, ask what if, play it back."""
