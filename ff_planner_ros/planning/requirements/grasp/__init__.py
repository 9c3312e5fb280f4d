"""What a grasp can take: the impulse of contact, and the wrench that moves what is held."""
